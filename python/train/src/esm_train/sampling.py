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


def normalise(points: F32, turned: bool = False) -> F32:
    """Zero mean, unit variance over all coordinates together, so that proportions stay; turned first where asked."""
    p = points.astype(np.float64)
    d = p - p.mean(axis=0)
    sigma = np.sqrt((d * d).mean())
    if turned:
        d = turn(d)
    normalised: F32 = (d / max(float(sigma), STD_FLOOR_M)).astype(np.float32)
    return normalised


def turn(centred: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Makes x the horizontal direction of largest variance, seen so that its third moment is not negative."""
    x, y = centred[:, 0], centred[:, 1]
    angle = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x * x).sum() - (y * y).sum())
    c, s = np.cos(angle), np.sin(angle)
    u, v = c * x + s * y, c * y - s * x
    if (u * u * u).sum() < 0.0:
        u, v = -u, -v
    return np.stack((u, v, centred[:, 2]), axis=1)


def rng_of_points(points: F32) -> np.random.Generator:
    """A generator keyed by the points themselves: the same sample wherever the segment stands in a batch."""
    digest = hashlib.blake2b(np.ascontiguousarray(points).tobytes(), digest_size=16).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest, "little")))
