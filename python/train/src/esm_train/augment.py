"""Augmentation of a segment, from a given generator: what another visit might have seen of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Augmentation:
    """Strengths; zero switches a step off. Probabilities are per segment and step."""

    yaw: bool = True
    """Uniform rotation about the up axis."""
    tilt_deg: float = 1.5
    """Deviation of a small rotation about a horizontal axis."""
    partial_probability: float = 0.5
    """Of a partial view: cut by a plane, an angular shadow, or hidden from below or above."""
    partial_keep: float = 0.5
    """Smallest share of the points that a partial view leaves."""
    density_probability: float = 0.3
    """Of another sensor's density: coarser voxels, or rings of a sensor with fewer beams."""
    dropout_keep: float = 0.6
    """Smallest share of points that point dropout leaves; the share is uniform up to 1."""
    jitter_m: float = 0.02
    """Deviation of the noise on each coordinate, itself uniform from 0."""
    min_points: int = 25
    """A step that would leave fewer points is not taken."""


NONE = Augmentation(
    yaw=False,
    tilt_deg=0.0,
    partial_probability=0.0,
    density_probability=0.0,
    dropout_keep=1.0,
    jitter_m=0.0,
)


def augment(points: F32, how: Augmentation, rng: np.random.Generator) -> F32:
    """Points (n, 3) in metres about the segment's centroid, z up -> points of another view of it."""
    p = points
    if rng.random() < how.partial_probability:
        p = _kept(p, _partial_view(p, how.partial_keep, rng), how)
    if rng.random() < how.density_probability:
        p = _kept(p, _thinned(p, rng), how)
    if how.dropout_keep < 1.0:
        p = _kept(p, rng.random(len(p)) < rng.uniform(how.dropout_keep, 1.0), how)
    if how.jitter_m > 0.0:
        sigma = rng.uniform(0.0, how.jitter_m)
        p = p + rng.standard_normal(p.shape, dtype=np.float32) * np.float32(sigma)
    rotation = np.eye(3)
    if how.tilt_deg > 0.0:
        rotation = _tilt(np.deg2rad(rng.normal(0.0, how.tilt_deg)), rng.uniform(0.0, 2.0 * np.pi))
    if how.yaw:
        rotation = _yaw(rng.uniform(0.0, 2.0 * np.pi)) @ rotation
    turned: F32 = p @ rotation.T.astype(np.float32)
    return turned


def _kept(points: F32, mask: npt.NDArray[np.bool_], how: Augmentation) -> F32:
    return points[mask] if np.count_nonzero(mask) >= min(how.min_points, len(points)) else points


def _partial_view(points: F32, keep: float, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Which points are seen when part of the object is hidden."""
    share = rng.uniform(keep, 1.0)
    kind = rng.integers(4)
    if kind == 0:  # A plane of any bearing cuts off the far end: another object stands before it.
        bearing, slope = rng.uniform(0.0, 2.0 * np.pi), rng.normal(0.0, 0.3)
        along = points @ np.array([np.cos(bearing), np.sin(bearing), slope], np.float32)
        return _lowest(along, share)
    if kind == 1:  # A pole or trunk casts an angular shadow from a sensor some metres away.
        bearing, distance = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(4.0, 30.0)
        azimuth = np.arctan2(points[:, 1] - distance * np.sin(bearing), points[:, 0] - distance * np.cos(bearing))
        azimuth = np.angle(np.exp(1j * (azimuth - bearing - np.pi)))
        ranks = np.argsort(np.argsort(azimuth, kind="stable"), kind="stable") / len(points)
        start = rng.uniform(0.0, share)
        mask: npt.NDArray[np.bool_] = (ranks < start) | (ranks >= start + (1.0 - share))
        return mask
    # Hidden from below by the ground's growth, or cut above by the sensor's field of view.
    return _lowest(points[:, 2] if kind == 2 else -points[:, 2], share)


def _lowest(values: F32, share: float) -> npt.NDArray[np.bool_]:
    mask: npt.NDArray[np.bool_] = values <= np.quantile(values, share)
    return mask


def _thinned(points: F32, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Which points another sensor returns."""
    if rng.random() < 0.5:  # Coarser voxels: the first point of each.
        cells = np.floor(points / np.float32(rng.uniform(0.2, 0.45)) + rng.random(3, dtype=np.float32))
        key = (cells.astype(np.int64) + (1 << 20)) @ np.array([1 << 42, 1 << 21, 1])
        mask = np.zeros(len(points), bool)
        mask[np.unique(key, return_index=True)[1]] = True
        return mask
    # Rings: elevation angles from a sensor at some distance, every other band missing.
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(4.0, 30.0)
    dx = points[:, 0] - distance * np.cos(bearing)
    dy = points[:, 1] - distance * np.sin(bearing)
    elevation = np.arctan2(points[:, 2] - rng.uniform(-1.0, 2.0), np.hypot(dx, dy))
    phase = (elevation / np.deg2rad(rng.uniform(0.5, 2.0)) + rng.random()) % 1.0
    rings: npt.NDArray[np.bool_] = phase < rng.uniform(0.3, 0.8)
    return rings


def _yaw(angle: float) -> npt.NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _tilt(angle: float, bearing: float) -> npt.NDArray[np.float64]:
    """Rotation by `angle` about the horizontal axis of that bearing."""
    c, s = np.cos(angle), np.sin(angle)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    rotation: npt.NDArray[np.float64] = _yaw(bearing) @ about_x @ _yaw(-bearing)
    return rotation
