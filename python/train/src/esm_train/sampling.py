"""A segment's points to the network's input: sampling and normalisation (WEIGHTS.md, Preprocessing)."""

from __future__ import annotations

import hashlib

import numpy as np
import numpy.typing as npt

from esm_train.plan import STD_FLOOR_M

F32 = npt.NDArray[np.float32]


def sample(points: F32, count: int, rng: np.random.Generator) -> F32:
    """`count` points in random order: without replacement while there are enough, then with."""
    n = len(points)
    order = rng.permutation(n)[:count]
    if n < count:
        order = np.concatenate((order, rng.integers(0, n, count - n)))
    return points[order]


def normalise(points: F32) -> F32:
    """Zero mean, unit variance over all coordinates together, so that proportions stay."""
    p = points.astype(np.float64)
    d = p - p.mean(axis=0)
    sigma = np.sqrt((d * d).mean())
    normalised: F32 = (d / max(float(sigma), STD_FLOOR_M)).astype(np.float32)
    return normalised


def rng_of_points(points: F32) -> np.random.Generator:
    """A generator keyed by the points themselves: the same sample wherever the segment stands in a batch."""
    digest = hashlib.blake2b(np.ascontiguousarray(points).tobytes(), digest_size=16).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest, "little")))
