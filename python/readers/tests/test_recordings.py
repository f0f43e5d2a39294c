"""Simulated recordings as others see them: their form, their times, their truth."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from recording import READERS, Cloud, Contents

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    from conftest import Simulated

    Floats = npt.NDArray[np.float64]

# Name, offset, sensor_msgs/msg/PointField's kind, count.
FIELDS = [
    ("x", 0, 7, 1),
    ("y", 4, 7, 1),
    ("z", 8, 7, 1),
    ("intensity", 12, 7, 1),
    ("time", 16, 7, 1),
    ("object_id", 20, 6, 1),
    ("ring", 24, 4, 1),
    ("class", 26, 2, 1),
]
GROUND = {1, 2, 3, 4, 5}
THINGS = {5, *range(10, 17), *range(20, 24), *range(30, 35), *range(40, 43)}
MOVERS = set(range(50, 55))


@cache
def contents(reader: str, path: Path) -> Contents:
    """Read a file once."""
    return READERS[reader](path)


@pytest.fixture(params=list(READERS))
def found(request: pytest.FixtureRequest, simulated: Simulated, visit: str) -> Contents:
    """Tell what a reader finds in a visit."""
    return contents(request.param, simulated.folder / f"{visit}.mcap")


@pytest.fixture
def truth(simulated: Simulated, visit: str) -> Floats:
    """Rows of the visit's TUM file: seconds, position, quaternion (x y z w)."""
    return np.loadtxt(simulated.folder / f"{visit}_truth.tum", ndmin=2)


def rotation(q: Floats) -> Floats:
    """Make a matrix of a quaternion (x y z w)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def in_map(cloud: Cloud, pose: Floats) -> Floats:
    """Move a cloud's points by a row of the truth."""
    points = cloud.points()
    xyz = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64)
    moved: Floats = xyz @ rotation(pose[4:8]).T + pose[1:4]
    return moved


def test_both_readers_find_the_same(simulated: Simulated, visit: str) -> None:
    """Everything the two readers tell is equal."""
    path = simulated.folder / f"{visit}.mcap"
    one, other = (contents(reader, path) for reader in READERS)
    assert len(one.clouds) > 3
    assert one == other


def test_clouds_have_the_documented_form(found: Contents, simulated: Simulated) -> None:
    """Fields, sizes and frames, and values within what the sensor can measure."""
    for cloud in found.clouds:
        width, height = cloud.size
        assert cloud.fields == FIELDS
        assert height == 1
        assert cloud.steps == (28, 28 * width)
        assert len(cloud.data) == 28 * width
        assert not cloud.big_endian
        assert cloud.frame == "lidar"
        points = cloud.points()
        assert len(points) == width
        for axis in ("x", "y", "z", "intensity", "time"):
            assert np.isfinite(points[axis]).all()
        ranges = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
        assert ranges.min(initial=1.0) > 0.3
        assert ranges.max(initial=1.0) < 125.0
        assert points["ring"].max(initial=0) < simulated.lasers
        assert points["time"].min(initial=0.0) >= -simulated.sweep_s - 1e-6
        assert points["time"].max(initial=0.0) <= 0.0
        assert ((points["intensity"] >= 0) & (points["intensity"] <= 255)).all()
    # x forward, z up, push-brooms included: the ground about the carrier lies below the sensor.
    below = [
        points["z"][(points["object_id"] == 0) & (np.abs(points["y"]) < 4)]
        for points in map(Cloud.points, found.clouds)
    ]
    assert -2.2 < np.median(np.concatenate(below)) < -0.8
    sizes = [cloud.size[0] for cloud in found.clouds]
    assert np.mean(sizes) > 100 * min(simulated.lasers, 2)
    if simulated.lasers > 1:
        rings = set(np.unique(np.concatenate([cloud.points()["ring"] for cloud in found.clouds])))
        assert rings == set(range(simulated.lasers))


def test_times_go_on(found: Contents, truth: Floats) -> None:
    """Clouds, odometry and truth stand at the same times, one after the other."""
    stamps = [cloud.stamp_ns for cloud in found.clouds]
    assert stamps == sorted(set(stamps))
    assert stamps == [cloud.log_ns for cloud in found.clouds]
    assert stamps == [motion.stamp_ns for motion in found.motions]
    assert len(stamps) == len(truth)
    assert np.abs(np.array(stamps) * 1e-9 - truth[:, 0]).max() < 1e-6


def test_odometry_is_the_truth_with_some_drift(found: Contents, truth: Floats) -> None:
    """It starts at identity and goes the way of the truth, a few per cent off."""
    assert {motion.frames for motion in found.motions} == {("odom", "lidar")}
    poses = np.array([motion.pose for motion in found.motions])
    assert np.abs(poses[0] - np.array([0, 0, 0, 0, 0, 0, 1])).max() < 1e-9
    assert np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1).max() < 1e-9
    true = (truth[:, 1:4] - truth[0, 1:4]) @ rotation(truth[0, 4:8])
    travel = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
    assert travel > 2.0
    off = np.linalg.norm(poses[:, :3] - true, axis=1)
    assert off.max() < 0.02 + 0.05 * travel
    assert off.max() > 1e-4, "no drift at all"


def test_objects_keep_number_class_and_place(found: Contents, truth: Floats) -> None:
    """A number is one thing of one class; what stands is at one place of the map, sweep after sweep."""
    classes: dict[int, int] = {}
    places: dict[int, list[Floats]] = {}
    for cloud, pose in zip(found.clouds, truth, strict=True):
        points, at = cloud.points(), in_map(cloud, pose)
        on_ground = points["object_id"] == 0
        assert set(np.unique(points["class"][on_ground])) <= GROUND
        assert set(np.unique(points["class"][~on_ground])) <= THINGS | MOVERS
        moves = (points["object_id"] & 0xFFFF == 0) & ~on_ground
        assert (moves == np.isin(points["class"], list(MOVERS))).all()
        # Numbers are sorted once: every thing's points are then a run.
        order = np.argsort(points["object_id"], kind="stable")
        numbers, starts = np.unique(points["object_id"][order], return_index=True)
        for number, own in zip(numbers.tolist(), np.split(order, starts[1:]), strict=True):
            if number == 0:
                continue
            kinds = set(points["class"][own].tolist())
            assert len(kinds) == 1, f"{number} is {kinds}"
            assert classes.setdefault(number, kinds.pop()) in THINGS | MOVERS
            assert classes[number] == points["class"][own[0]]
            if len(own) >= 30:
                places.setdefault(number, []).append(np.median(at[own], axis=0))
    assert len(classes) > 20
    fixed = [np.array(p) for n, p in places.items() if classes[n] in {10, 30, 31, 33} and len(p) > 1]
    if fixed:
        # The sensor goes a few metres: trees and lamps are seen from about one side, crowns more and more.
        spreads = np.array([np.ptp(seen[:, :2], axis=0).max() for seen in fixed])
        assert np.median(spreads) < 0.5, f"{np.median(spreads)} m apart"
        assert np.quantile(spreads, 0.9) < 1.5, f"{spreads.max()} m apart"


def test_ground_is_one_surface(simulated: Simulated) -> None:
    """Ground points of both visits, moved by the truth, lie at the same heights."""
    cells: list[dict[tuple[int, int], float]] = []
    for visit in ("map", "live"):
        truth = np.loadtxt(simulated.folder / f"{visit}_truth.tum", ndmin=2)
        clouds = contents("rosbags", simulated.folder / f"{visit}.mcap").clouds
        ground = []
        for cloud, pose in zip(clouds, truth, strict=True):
            at = in_map(cloud, pose)[cloud.points()["object_id"] == 0]
            ground.append(at[np.linalg.norm(at - pose[1:4], axis=1) < 12.0])
        at = np.concatenate(ground)
        keys = np.floor(at[:, :2]).astype(int)
        heights: dict[tuple[int, int], list[float]] = {}
        for (i, j), z in zip(keys.tolist(), at[:, 2].tolist(), strict=True):
            heights.setdefault((i, j), []).append(z)
        cells.append({key: float(np.median(z)) for key, z in heights.items() if len(z) > 4})
    common = sorted(cells[0].keys() & cells[1].keys())
    assert len(common) > 8
    off = np.array([cells[0][key] - cells[1][key] for key in common])
    assert np.median(np.abs(off)) < 0.08
