"""The quality head: a logistic regression on the frozen descriptor, fitted on one half and calibrated on the other."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from esm_train.errors import TrainError
from esm_train.metrics import F32, Bool, Sides, nearest_in_map, random_negatives, roc
from esm_train.model import QualityHead


def nearest_is_right(sides: Sides, live: F32, mapped: F32) -> Bool:
    """The label: whether the nearest map descriptor is the same object (K = 1; the map holds other observations)."""
    index, _ = nearest_in_map(live, mapped, sides.live_place, sides.map_place, 1)
    rows = np.arange(len(live))
    right: Bool = (index[:, 0] >= 0) & sides.same(rows, np.maximum(index[:, 0], 0))
    return right


def train_quality(descriptors: F32, labels: Bool, seed: int = 0) -> tuple[QualityHead, dict[str, float]]:
    """Softmax cross-entropy by L-BFGS on three quarters, then the temperature on the held-out quarter.

    The problem is convex, so it is solved instead of stopped at the paper's 70 %; the held-out accuracy is reported
    beside that of the constant answer.
    """
    if len(labels) < 40 or labels.all() or not labels.any():
        raise TrainError(
            f"quality: {int(labels.sum())} of {len(labels)} segments are matched rightly, no head can be fitted",
            "give larger sets in [quality]",
        )
    order = np.random.default_rng([seed, 20]).permutation(len(labels))
    x = torch.from_numpy(descriptors[order].astype(np.float64))
    y = torch.from_numpy(labels[order].astype(np.int64))
    cut = 3 * len(labels) // 4
    mean, std = x[:cut].mean(dim=0), x[:cut].std(dim=0).clamp(min=1e-6)
    z = (x - mean) / std
    weight = torch.zeros(x.shape[1], 2, dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    _minimise([weight, bias], lambda: F.cross_entropy(z[:cut] @ weight + bias, y[:cut]) + 1e-4 * (weight**2).sum())
    log_temperature = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    logits = (z[cut:] @ weight + bias).detach()
    _minimise([log_temperature], lambda: F.cross_entropy(logits / torch.exp(log_temperature), y[cut:]))
    head = QualityHead(x.shape[1])
    with torch.no_grad():
        # The standardisation is folded into the layer.
        head.weight.copy_(weight / std[:, None])
        head.bias.copy_(bias - (mean / std) @ weight)
    head.temperature = float(torch.exp(log_temperature.detach()).clamp(0.2, 5.0))
    chance = head.probability(x[cut:].float()).detach().numpy().astype(np.float64)
    held = labels[order][cut:]
    facts = {
        "segments": float(len(labels)),
        "share_right": float(held.mean()),
        "accuracy": float(((chance > 0.5) == held).mean()),
        "constant_accuracy": float(max(held.mean(), 1.0 - held.mean())),
        "auc": roc(chance[held], chance[~held]).auc,
        "temperature": head.temperature,
    }
    return head, facts


def _minimise(parameters: list[Tensor], value: object) -> None:
    assert callable(value)
    solver = torch.optim.LBFGS(parameters, max_iter=200, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        solver.zero_grad()
        loss: Tensor = value()
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    solver.step(closure)  # type: ignore[no-untyped-call]


def distance_thresholds(sides: Sides, live: F32, mapped: F32, seed: int = 0) -> dict[str, str]:
    """`max_distance_fpr_*`: L2 distance under which that share of random negative pairs falls."""
    pairs = random_negatives(sides, np.arange(len(live)), seed)
    if not len(pairs.live):
        return {}
    d = np.linalg.norm(live[pairs.live].astype(np.float64) - mapped[pairs.map].astype(np.float64), axis=1)
    return {f"max_distance_fpr_{rate}": f"{np.quantile(d, rate):.6g}" for rate in (0.1, 0.2)}
