"""The last layers, trained on frozen X-conv layers: thousands of objects compete in a batch, as they do in a map.

A step through the whole network costs a millisecond a segment and sees a hundred of them; what follows the mean over
the points is a thousand times cheaper. So the numbers that stand for a segment's shape are computed once, and the
layers that join them with sizes and context learn from batches as large as a map.
"""

from __future__ import annotations

import dataclasses
import hashlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from esm_train.checkpoint import atomically
from esm_train.config import Config
from esm_train.corpus import BatchSampler, Corpus
from esm_train.errors import TrainError
from esm_train.inputs import Inputs, inference_inputs
from esm_train.losses import parted_loss
from esm_train.metrics import F32, I64
from esm_train.model import SIZE_RATE, EsmNet
from esm_train.plan import Plan
from esm_train.validation import Validation

PIECE = 128


class _Pieces(Dataset[Inputs]):
    """Inputs of a corpus's rows, piece by piece."""

    def __init__(self, corpus: Corpus, rows: I64, plan: Plan) -> None:
        self.corpus, self.rows, self.plan = corpus, rows, plan

    def __len__(self) -> int:
        return -(-len(self.rows) // PIECE)

    def __getitem__(self, piece: int) -> Inputs:
        return inference_inputs(self.corpus, self.rows[piece * PIECE : (piece + 1) * PIECE], self.plan)


@torch.no_grad()
def shapes(
    model: EsmNet, corpus: Corpus, rows: I64, device: torch.device, *, workers: int, bf16: bool
) -> tuple[F32, F32]:
    """What the layers before the last ones make of segments: (N, hidden), and the standardised measures."""
    model.eval()
    pooled, measured = [], []
    pieces = DataLoader(_Pieces(corpus, rows, model.plan), batch_size=None, num_workers=workers)
    for inputs in tqdm(pieces, unit="piece", disable=not sys.stderr.isatty()):
        part = inputs.to(device, model.plan)
        with torch.autocast(device.type, torch.bfloat16, enabled=bf16):
            z = model.standardised(part.measures)
            shape = model.pooled(part.points, model.features(part.points, part.neighbours), z)
        pooled.append(shape.float().cpu().numpy())
        measured.append(z.float().cpu().numpy())
    return np.concatenate(pooled), np.concatenate(measured)


def kept_shapes(model: EsmNet, corpus: Corpus, rows: I64, config: Config, device: torch.device) -> tuple[F32, F32]:
    """The same, kept in the run's directory for as long as network and rows are the same."""
    digest = hashlib.blake2b(digest_size=16)
    for name, tensor in model.state_dict().items():
        if name.startswith(("xconv", "global", "fc1", "fc2", "measures")):
            digest.update(tensor.cpu().numpy().tobytes())
    digest.update(rows.tobytes())
    file = Path(config.run.out) / f"shapes-{digest.hexdigest()}.npz"
    if file.exists():
        with np.load(file) as kept:
            return kept["pooled"], kept["measured"]
    bf16 = config.run.precision == "bf16"
    pooled, measured = shapes(model, corpus, rows, device, workers=config.run.workers, bf16=bf16)

    def write(part: Path) -> None:
        with part.open("wb") as handle:
            np.savez(handle, pooled=pooled, measured=measured)

    atomically(file, write)
    return pooled, measured


def rows_to_hold(sampler: BatchSampler, most: int, seed: int) -> I64:
    """Rows of objects seen more than once, whole objects at random up to `most`; ascending."""
    order = np.random.default_rng([seed, 5]).permutation(len(sampler.identities))
    counts = np.diff(sampler.identities.starts)[order]
    kept = order[np.cumsum(counts) <= most]
    if not len(kept):
        raise TrainError("head.most_segments is less than one object has")
    return np.sort(np.concatenate([sampler.identities.of(int(i)) for i in kept]))


def train_head(
    model: EsmNet, corpus: Corpus, config: Config, validation: Validation | None, device: torch.device
) -> list[dict[str, float]]:
    """Trains join, fc3 and the sizes' weights in place; returns the history."""
    if not model.plan.context:
        raise TrainError("head.steps: this network has no layer that joins shape and context", "set head.steps = 0")
    h = config.head
    batch = dataclasses.replace(config.batch, classes=h.classes, places=h.places)
    whole = BatchSampler(corpus, dataclasses.replace(batch, hard_fraction=0.0), config.run.seed)
    rows = rows_to_hold(whole, h.most_segments, config.run.seed)
    pooled, measured = (torch.from_numpy(a).to(device) for a in kept_shapes(model, corpus, rows, config, device))
    place = np.full(len(corpus), -1, np.int64)
    place[rows] = np.arange(len(rows))
    sampler = BatchSampler(corpus, batch, config.run.seed, rows)
    labels = torch.arange(h.classes, device=device).repeat_interleave(batch.per_class)
    model.requires_grad_(False)
    torch.manual_seed(config.run.seed)
    trained = _trained(model)
    optimizer = torch.optim.Adam(trained, lr=h.learning_rate)
    history: list[dict[str, float]] = []
    bar = tqdm(range(h.steps), unit="step", disable=not sys.stderr.isatty())
    for step in bar:
        for group in optimizer.param_groups:
            rate = h.learning_rate * (h.learning_rate_end / h.learning_rate) ** (step / max(h.steps - 1, 1))
            group["lr"] = rate * group["rate"]
        model.eval()
        model.join.train()
        index = torch.from_numpy(place[sampler.rows(step)]).to(device)
        torch.manual_seed(config.run.seed * 1_000_003 + step)
        shape = nn.functional.dropout(pooled[index], h.dropout)
        loss = parted_loss(model.descriptor(shape, measured[index]), model.plan.learned_dim, labels, config.loss)
        optimizer.zero_grad(set_to_none=True)
        loss.total.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        if (step + 1) % 100 == 0 or step + 1 == h.steps:
            record = {"step": float(step + 1), "loss": float(loss.total.detach())}
            if validation is not None and ((step + 1) % 500 == 0 or step + 1 == h.steps):
                record |= validation(model, device)
            history.append(record)
            tqdm.write(" ".join(f"{k} {v:.4g}" for k, v in record.items()), file=sys.stderr)
    model.requires_grad_(True)
    model.eval()
    return history


def _trained(model: EsmNet) -> list[dict[str, Any]]:
    """The parameters of the last layers, begun anew: those the training left know only small batches."""
    with torch.no_grad():
        fresh = EsmNet(model.plan)
        model.join.load_state_dict(fresh.join.state_dict())
        gain = float(model.fc3_weight.std() / fresh.fc3_weight.std())
        model.fc3_weight.copy_(fresh.fc3_weight * gain)
        model.fc3_bias.zero_()
    last = [*model.join.parameters(), model.fc3_weight, model.fc3_bias]
    groups: list[dict[str, Any]] = [{"params": last, "rate": 1.0}]
    if model.plan.size_mode in ("beside", "both"):
        groups.append({"params": [model.size_log_weight], "rate": SIZE_RATE})
    for group in groups:
        for parameter in group["params"]:
            parameter.requires_grad_(True)
    return groups
