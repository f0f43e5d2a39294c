"""Synthetic objects seen in part: boxes, cylinders, balls and combinations, for tests and for trying things out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from esm_train.plan import CONTEXT
from esm_train.segments import SegmentWriter

F32 = npt.NDArray[np.float32]

CLASSES = ("box", "cylinder", "ball", "tree")
VOXEL_M = 0.2


def object_surface(label: int, rng: np.random.Generator) -> tuple[F32, F32]:
    """Points (n, 3) in metres on the surface of a random object standing on z = 0, and their outward normals."""
    if label == 0:
        return _box(rng.uniform([1.0, 0.5, 0.8], [6.0, 2.5, 3.5]), rng)
    if label == 1:
        return _cylinder(rng.uniform(0.15, 0.8), rng.uniform(1.5, 8.0), rng)
    if label == 2:
        return _ball(np.zeros(3), rng.uniform([0.5, 0.5, 0.4], [2.5, 2.0, 2.0]), rng)
    height = rng.uniform(1.5, 4.0)
    parts = [_cylinder(rng.uniform(0.12, 0.3), height, rng)]
    for _ in range(int(rng.integers(1, 4))):
        centre = np.array([*rng.normal(0.0, 0.5, 2), height + rng.uniform(-0.3, 1.5)])
        parts.append(_ball(centre, rng.uniform(0.5, 1.6, 3), rng))
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def _count(area: float) -> int:
    return int(np.clip(area * 60.0, 200, 8000))


def _box(size: npt.NDArray[np.float64], rng: np.random.Generator) -> tuple[F32, F32]:
    n = _count(2.0 * float(size[0] * size[1] + size[1] * size[2] + size[0] * size[2]))
    areas = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]]).repeat(2)
    face = rng.choice(6, n, p=areas / areas.sum())
    p = rng.uniform(-0.5, 0.5, (n, 3))
    normal = np.zeros((n, 3))
    sign = np.where(face % 2 == 0, 0.5, -0.5)
    p[np.arange(n), face // 2] = sign
    normal[np.arange(n), face // 2] = 2.0 * sign
    p = (p + np.array([0.0, 0.0, 0.5])) * size
    return p.astype(np.float32), normal.astype(np.float32)


def _cylinder(radius: float, height: float, rng: np.random.Generator) -> tuple[F32, F32]:
    n = _count(2.0 * np.pi * radius * height)
    a = rng.uniform(0.0, 2.0 * np.pi, n)
    normal = np.stack((np.cos(a), np.sin(a), np.zeros(n)), axis=1)
    p = normal * radius + np.stack((np.zeros(n), np.zeros(n), rng.uniform(0.0, height, n)), axis=1)
    return p.astype(np.float32), normal.astype(np.float32)


def _ball(centre: npt.NDArray[np.float64], radii: npt.NDArray[np.float64], rng: np.random.Generator) -> tuple[F32, F32]:
    n = _count(4.0 * np.pi * float(np.prod(radii)) ** (2.0 / 3.0))
    u = rng.standard_normal((n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return (centre + u * radii).astype(np.float32), u.astype(np.float32)


def view(surface: F32, normals: F32, sensor: npt.NDArray[np.float64], rng: np.random.Generator) -> F32:
    """What a sensor at `sensor` sees of the surface: the sides that face it, with range noise, in 0.2 m voxels."""
    facing = ((sensor - surface) * normals).sum(axis=1) > 0.0
    p = surface[facing] if np.count_nonzero(facing) >= 40 else surface
    p = p + rng.normal(0.0, 0.01, p.shape).astype(np.float32)
    cells = np.floor(p / VOXEL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    picked: F32 = p[np.sort(first)] if len(first) >= 20 else p
    return picked.astype(np.float32)


def write_synthetic(
    path: Path,
    *,
    objects: int,
    observations: int = 2,
    seed: int = 0,
    visit: int = 0,
    place: str | None = None,
    spacing_m: float = 30.0,
    overwrite: bool = False,
) -> None:
    """A set of `objects` on a grid, each seen `observations` times from random bearings.

    The objects depend on `seed` and `place` (named after the seed, unless it is given) alone, the views on `visit`
    too: two calls that differ in `visit` give the map and the live set of one place.
    """
    place = place or f"synthetic:{seed}"
    writer = SegmentWriter(
        path,
        places=[place],
        classes=list(CLASSES),
        voxel_m=VOXEL_M,
        source=f"synthetic, {objects} objects, seed {seed}, visit {visit}",
        overwrite=overwrite,
    )
    columns = int(np.ceil(np.sqrt(objects)))
    key = [seed, *place.encode()]
    for number in range(objects):
        world = np.random.default_rng([0, number, *key])
        label = int(world.integers(len(CLASSES)))
        surface, normals = object_surface(label, world)
        around = np.abs(world.normal(0.2, 0.1, CONTEXT))
        where = np.array([number % columns, number // columns, 0.0]) * spacing_m
        for time in range(observations):
            eye = np.random.default_rng([1, visit, time, number, *key])
            bearing, distance = eye.uniform(0.0, 2.0 * np.pi), eye.uniform(5.0, 25.0)
            sensor = np.array([distance * np.cos(bearing), distance * np.sin(bearing), 1.7])
            points = view(surface, normals, sensor, eye)
            mean = points.astype(np.float64).mean(axis=0)
            writer.add(
                (points - mean).astype(np.float32),
                centroid_map=where + mean,
                object_id=number,
                observation=visit * observations + time,
                visit=visit,
                label=label,
                above_ground=0.0,
                rings=np.abs(around + eye.normal(0.0, 0.03, CONTEXT)).astype(np.float32),
            )
    writer.close()
