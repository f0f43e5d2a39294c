"""How much the learned numbers weigh against the sizes beside them: one factor, chosen on sets not trained on.

A training sees a hundred objects at a time; in a map of thousands the noise of sixteen learned numbers weighs more.
"""

from __future__ import annotations

import numpy as np
import torch

from esm_train.metrics import F32, Sides, nearest_in_map, recall_at
from esm_train.model import EsmNet

FACTORS = tuple(2.0 ** (step / 4) for step in range(-16, 5))
"""1/16 to 2."""

AT = (1, 5, 25)


def balance(sides: Sides, live: F32, mapped: F32, learned_dim: int) -> tuple[float, dict[str, dict[str, float]]]:
    """The factor on the learned numbers of highest recall (mean of @1, @5 and @25), and the recalls of all."""
    rows = np.arange(len(live))
    tried: dict[str, dict[str, float]] = {}
    best, chosen = -1.0, 1.0
    for factor in FACTORS:
        weights = np.ones(live.shape[1], np.float32)
        weights[:learned_dim] = factor
        index, _ = nearest_in_map(live * weights, mapped * weights, sides.live_place, sides.map_place, max(AT))
        recall = recall_at(sides, rows, index, AT)
        tried[f"{factor:.3f}"] = {f"recall@{k}": round(v, 4) for k, v in recall.items()}
        mean = sum(recall.values()) / len(AT)
        if mean > best:
            best, chosen = mean, factor
    return chosen, tried


@torch.no_grad()
def apply(model: EsmNet, factor: float) -> None:
    """Puts the factor into the last layer."""
    model.fc3_weight.mul_(factor)
    model.fc3_bias.mul_(factor)
