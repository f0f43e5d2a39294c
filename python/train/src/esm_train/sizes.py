"""Metric sizes and eigenvalue features of segments, many at a time.

The six sizes are those of the `shape` descriptor of esm-core, ln(length + 0.1 m); the seven eigenvalue features are
its `eigen` descriptor (SegMatch, Dube et al., ICRA 2017, by the intended formulas).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from esm_train.plan import Plan

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

LENGTH_FLOOR_M = 0.1
"""Added to a length before its log: half a voxel, so that the noise in a flat object's thickness does not dominate."""

EIGENVALUE_FLOOR_M2 = 1e-6


def _moments(points: F32, offsets: I64) -> tuple[F64, F64, F64]:
    """Centred points (M, 3), covariances (N, 3, 3), heights (N,)."""
    p = points.astype(np.float64)
    starts, counts = offsets[:-1], np.diff(offsets)
    mean = np.add.reduceat(p, starts, axis=0) / counts[:, None]
    d = p - np.repeat(mean, counts, axis=0)
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    covariance = np.empty((len(counts), 3, 3))
    for a, b in pairs:
        value = np.add.reduceat(d[:, a] * d[:, b], starts) / counts
        covariance[:, a, b] = value
        covariance[:, b, a] = value
    height = np.maximum.reduceat(p[:, 2], starts) - np.minimum.reduceat(p[:, 2], starts)
    return d, covariance, height


def _eigenvalues(covariance: F64) -> F64:
    """(N, 3), descending, floored."""
    values: F64 = np.maximum(np.linalg.eigvalsh(covariance)[:, ::-1], EIGENVALUE_FLOOR_M2)
    return values


def lengths(points: F32, offsets: I64) -> F64:
    """(N, 6) in metres: sigma1, sigma2, sigma3, height, extent1, extent2, as WEIGHTS.md defines them."""
    d, covariance, height = _moments(points, offsets)
    starts, counts = offsets[:-1], np.diff(offsets)
    _, axes = np.linalg.eigh(covariance[:, :2, :2])
    along = np.einsum("na,nab->nb", d[:, :2], np.repeat(axes, counts, axis=0))
    extents = np.maximum.reduceat(along, starts, axis=0) - np.minimum.reduceat(along, starts, axis=0)
    extents = np.sort(extents, axis=1)[:, ::-1]
    return np.concatenate((np.sqrt(_eigenvalues(covariance)), height[:, None], extents), axis=1)


def metric_sizes(points: F32, offsets: I64, above_ground: F32, features: tuple[str, ...]) -> F32:
    """(N, len(features)): the named sizes before standardisation; NaN where the height above ground is unknown."""
    table = np.log(lengths(points, offsets) + LENGTH_FLOOR_M)
    above = np.log1p(np.maximum(above_ground.astype(np.float64), 0.0))
    columns = {
        **dict(zip(("sigma1", "sigma2", "sigma3", "height", "extent1", "extent2"), table.T, strict=True)),
        "above_ground": above,
    }
    picked = [columns[name] for name in features]
    return np.stack(picked, axis=1).astype(np.float32) if picked else np.zeros((len(above), 0), np.float32)


def measures(points: F32, offsets: I64, above_ground: F32, rings: F32, plan: Plan) -> F32:
    """(N, plan.measures): the plan's sizes, then the context."""
    table = metric_sizes(points, offsets, above_ground, plan.size_features)
    return np.concatenate((table, rings.astype(np.float32)), axis=1) if plan.context else table


def eigen_features(points: F32, offsets: I64) -> F32:
    """(N, 7): linearity, planarity, scattering, omnivariance, anisotropy, eigenentropy, change of curvature."""
    _, covariance, _ = _moments(points, offsets)
    values = _eigenvalues(covariance)
    l1, l2, l3 = (values / values.sum(axis=1, keepdims=True)).T
    entropy = -(l1 * np.log(l1) + l2 * np.log(l2) + l3 * np.log(l3))
    features = (
        (l1 - l2) / l1,
        (l2 - l3) / l1,
        l3 / l1,
        np.cbrt(l1 * l2 * l3),
        (l1 - l3) / l1,
        entropy,
        l3 / (l1 + l2 + l3),
    )
    return np.stack(features, axis=1).astype(np.float32)
