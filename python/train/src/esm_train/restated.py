"""The forward pass once more, in plain NumPy, from the tensors of a weights file: WEIGHTS.md read to the letter.

Independent of the PyTorch network, slow, and meant to be read beside the document; the tests hold the two together.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from esm_train.plan import Plan

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
Tensors = dict[str, F32]


@dataclass
class Activations:
    """What a forward pass of one segment went through."""

    descriptor: F32
    neighbours: list[I64] = field(default_factory=list)
    xconv: list[F32] = field(default_factory=list)
    absolute: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    fc1: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    fc2: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    pooled: F32 = field(default_factory=lambda: np.zeros(0, np.float32))


def elu(x: F32) -> F32:
    """x above zero, else exp(x) - 1."""
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, np.float32(0.0)))).astype(np.float32)


def dense(name: str, x: F32, t: Tensors, row: F32 | None = None) -> F32:
    """Linear, ELU, batch norm."""
    y = x @ t[f"{name}.weight"]
    if row is not None:
        y = y + row
    out: F32 = elu(y) * t[f"{name}.bn.scale"] + t[f"{name}.bn.shift"]
    return out


def nearest_by_sorting(points: F32, query: int, source: int, k: int, dilation: int) -> I64:
    """Neighbours of point `query` among the first `source` points: a full sort of (distance, index)."""
    order: list[tuple[np.float32, int]] = []
    for j in range(source):
        dx, dy, dz = points[query] - points[j]
        order.append(((dx * dx + dy * dy) + dz * dz, j))
    order.sort()
    return np.array([order[n * dilation][1] for n in range(k)])


def xconv(name: str, points: F32, query: int, index: I64, features: F32 | None, t: Tensors, k: int) -> F32:
    """One X-conv at one query point: features (C,)."""
    local = points[index] - points[query]
    f = dense(f"{name}.lift2", dense(f"{name}.lift1", local, t), t)
    if features is not None:
        f = np.concatenate((f, features[index]), axis=1)
    x0 = elu(local.reshape(3 * k) @ t[f"{name}.x0.weight"])
    x0 = (x0 * t[f"{name}.x0.bn.scale"] + t[f"{name}.x0.bn.shift"]).reshape(k, k)
    x1 = np.zeros((k, k), np.float32)
    for j in range(k):
        for i in range(k):
            x1[j] += x0[i, j] * t[f"{name}.x1.weight"][i, j]
    x1 = elu(x1).reshape(k * k) * t[f"{name}.x1.bn.scale"] + t[f"{name}.x1.bn.shift"]
    x1 = x1.reshape(k, k)
    x2 = np.zeros((k, k), np.float32)
    for q in range(k):
        for j in range(k):
            x2[q] += x1[j, q] * t[f"{name}.x2.weight"][j, q]
    x2 = (x2.reshape(k * k) * t[f"{name}.x2.bn.scale"] + t[f"{name}.x2.bn.shift"]).reshape(k, k)
    fx = x2 @ f
    weight = t[f"{name}.depthwise.weight"]
    channels, multiplier = weight.shape[1:]
    separate = np.zeros(channels * multiplier, np.float32)
    for c in range(channels):
        for q in range(multiplier):
            separate[c * multiplier + q] = fx[:, c] @ weight[:, c, q]
    return dense(f"{name}.pointwise", separate, t)


def forward(points: F32, measures: F32 | None, plan: Plan, t: Tensors) -> Activations:
    """One segment: 256 normalised points (256, 3), raw measures (plan.measures,) -> descriptor and what led to it."""
    out = Activations(np.zeros(0, np.float32))
    features: F32 | None = None
    for number, (kept, source, layer) in enumerate(zip(plan.points, plan.sources, plan.layers, strict=True), 1):
        lists = [nearest_by_sorting(points, i, source, layer.neighbours, layer.dilation) for i in range(kept)]
        rows = [xconv(f"xconv{number}", points, i, lists[i], features, t, layer.neighbours) for i in range(kept)]
        features = np.stack(rows)
        out.neighbours.append(np.stack(lists))
        out.xconv.append(features)
    assert features is not None
    query = points[: plan.points[-1]]
    out.absolute = dense("global2", dense("global1", query, t), t)
    z = np.zeros(0, np.float32)
    if plan.size_mode != "none":
        assert measures is not None
        z = np.nan_to_num((measures - t["measures.mean"]) / t["measures.std"], nan=0.0).astype(np.float32)
    row = z[: plan.sizes] @ t["fc1.size_weight"] if plan.size_mode in ("fc", "both") else None
    out.fc1 = dense("fc1", np.concatenate((out.absolute, features), axis=1), t, row)
    out.fc2 = dense("fc2", out.fc1, t)
    out.pooled = out.fc2.mean(axis=0)
    joined = dense("join", np.concatenate((out.pooled, z)), t) if plan.context else out.pooled
    learned = joined @ t["fc3.weight"] + t["fc3.bias"]
    beside = plan.size_mode in ("beside", "both")
    out.descriptor = np.concatenate((learned, z[: plan.sizes] * t["size.weight"])) if beside else learned
    return out


def quality(descriptor: F32, t: Tensors, temperature: float) -> float:
    """The chance that the nearest in the map is the same object."""
    logits = (descriptor @ t["quality.weight"] + t["quality.bias"]) / np.float32(temperature)
    e = np.exp(logits - logits.max())
    return float(e[1] / e.sum())
