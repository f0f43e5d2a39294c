"""A segment's points to SegMap's input: turned by its principal axes, fitted axis by axis into an occupancy grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from esm_train.sampling import turn

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

GRID = (32, 32, 16)
"""Cells along x, y and z."""

MIN_CELL_M = 0.1
"""Objects smaller than 3.2 x 3.2 x 1.6 m are not blown up: along each axis a cell measures at least this."""


def fitted(points: F32) -> tuple[npt.NDArray[np.int64], F32]:
    """Points (n, 3) in metres, z up -> the occupied cells (m, 3), sorted and unique, and the extents (3,) in metres.

    x is the horizontal direction of largest variance (`sampling.turn`, its sense by the third moment). Each axis is
    scaled by itself so that its extent, or the smallest one that is allowed, covers the grid; the mean of the points
    comes to the grid's middle and what then lies outside is left out, as in the published preprocessing.
    """
    p = points.astype(np.float64)
    d = turn(p - p.mean(axis=0))
    extents = d.max(axis=0) - d.min(axis=0)
    cells = np.array(GRID, np.float64)
    scale = np.maximum(extents, cells * MIN_CELL_M)
    at = np.floor(d / scale * (cells - 1.0) + (cells - 1.0) / 2.0).astype(np.int64)
    inside = ((at >= 0) & (at < np.array(GRID))).all(axis=1)
    number = np.unique(at[inside] @ np.array([GRID[1] * GRID[2], GRID[2], 1]))
    occupied = np.stack(np.unravel_index(number, GRID), axis=1).astype(np.int64)
    return occupied, extents.astype(np.float32)


def occupancy(points: F32) -> tuple[npt.NDArray[np.uint8], F32]:
    """The grid (32, 32, 16) of zeros and ones, and the extents (3,) in metres."""
    occupied, extents = fitted(points)
    grid = np.zeros(GRID, np.uint8)
    grid[tuple(occupied.T)] = 1
    return grid, extents
