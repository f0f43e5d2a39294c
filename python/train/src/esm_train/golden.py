"""Golden activations (WEIGHTS.md): what other implementations of the forward pass are held against."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save_file

from esm_train.checkpoint import atomically
from esm_train.corpus import Corpus
from esm_train.inputs import Inputs, inference_inputs, make_inputs
from esm_train.model import EsmNet, QualityHead
from esm_train.plan import CONTEXT
from esm_train.sampling import rng_of_points, sample
from esm_train.sizes import measures
from esm_train.synthetic import CLASSES, object_surface, view

TRACED_POINTS = 8
"""Query points whose activations are kept."""


def golden_inputs(model: EsmNet, count: int, seed: int) -> Inputs:
    """Views of `count` synthetic objects, some of fewer than 256 points."""
    views = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        surface, normals = object_surface(number % len(CLASSES), rng)
        seen = view(surface, normals, np.array([*rng.uniform(5.0, 20.0, 2), 1.7]), rng)
        if number % 4 == 3:
            seen = seen[: 40 + 10 * (number % 13)]
        views.append((seen - seen.astype(np.float64).mean(axis=0)).astype(np.float32))
    offsets = np.concatenate(([0], np.cumsum([len(v) for v in views]))).astype(np.int64)
    above = np.linspace(-0.2, 3.0, count).astype(np.float32)
    above[::5] = np.nan
    samples = [sample(v, model.plan.input_points, rng_of_points(v)) for v in views]
    points, rings = (
        np.concatenate(views),
        np.abs(np.random.default_rng([seed, count]).normal(0.1, 0.1, (count, CONTEXT))),
    )
    measured = measures(points, offsets, above, rings.astype(np.float32), model.plan)
    return make_inputs(samples, measured, model.plan, lists=True)


@torch.no_grad()
def trace(model: EsmNet, head: QualityHead, inputs: Inputs) -> dict[str, np.ndarray]:
    """The tensors of the golden file."""
    model.eval()
    plan, n, t = model.plan, len(inputs), TRACED_POINTS
    z = model.standardised(inputs.measures)
    out: dict[str, np.ndarray] = {"points": inputs.points.numpy()}
    if plan.size_mode != "none":
        out["measures"] = inputs.measures.numpy()
    features: torch.Tensor | None = None
    for number, (layer, index, source) in enumerate(zip(model.xconv, inputs.neighbours, plan.sources, strict=True), 1):
        features = layer(inputs.points[:, :source], features, index)
        per_point = features.view(n, -1, features.shape[1])
        out[f"xconv{number}.neighbours"] = index[:, :t].to(torch.int32).contiguous().numpy()
        out[f"xconv{number}.out"] = per_point[:, :t].contiguous().numpy()
        out[f"xconv{number}.mean"] = per_point.mean(dim=1).numpy()
    assert features is not None
    query = inputs.points[:, : plan.points[-1]].reshape(-1, 3)
    absolute = model.global2(model.global1(query))
    row = model.sizes(z) @ model.fc1_size_weight if plan.size_mode in ("fc", "both") else None
    fc1 = model.fc1(torch.cat((absolute, features), dim=1), row)
    fc2 = model.fc2(fc1)
    for name, value in (("global", absolute), ("fc1", fc1), ("fc2", fc2)):
        out[f"{name}.out"] = value.view(n, -1, value.shape[1])[:, :t].contiguous().numpy()
    out["fc2.mean"] = fc2.view(n, -1, fc2.shape[1]).mean(dim=1).numpy()
    descriptor = model(inputs.points, inputs.neighbours, inputs.measures)
    out["descriptor"] = descriptor.numpy()
    out["quality"] = head.probability(descriptor).numpy()
    return out


def write_golden(model: EsmNet, head: QualityHead, weights: Path, file: Path, *, count: int, seed: int) -> int:
    """Writes the golden file of a weights file; returns its size in bytes."""
    return _write(trace(model, head, golden_inputs(model, count, seed)), model, weights, file)


@torch.no_grad()
def write_answers(model: EsmNet, head: QualityHead, weights: Path, corpus: Corpus, file: Path, count: int) -> int:
    """The same for `count` segments of labelled sets, evenly spread, with inputs and answers only."""
    rows = np.unique(np.linspace(0, len(corpus) - 1, count).astype(np.int64))
    model.eval()
    out: dict[str, list[np.ndarray]] = {}
    for piece in np.array_split(rows, max(1, len(rows) // 64)):
        inputs = inference_inputs(corpus, piece, model.plan)
        descriptor = model(inputs.points, inputs.neighbours, inputs.measures)
        answers = {"points": inputs.points, "descriptor": descriptor, "quality": head.probability(descriptor)}
        if model.plan.size_mode != "none":
            answers["measures"] = inputs.measures
        for name, value in answers.items():
            out.setdefault(name, []).append(value.numpy())
    return _write({name: np.concatenate(parts) for name, parts in out.items()}, model, weights, file)


def _write(traced: dict[str, np.ndarray], model: EsmNet, weights: Path, file: Path) -> int:
    # safetensors writes the bytes as they lie: a strided view would come out wrong.
    tensors = {name: np.ascontiguousarray(value) for name, value in traced.items()}
    metadata = {
        "format": "esm-golden",
        "format_version": "1",
        "variant": model.plan.variant,
        "weights_blake2b": hashlib.blake2b(weights.read_bytes(), digest_size=32).hexdigest(),
    }
    atomically(file, lambda part: save_file(tensors, part, metadata=metadata))
    return file.stat().st_size
