"""Labelled segments: the command line's sets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import esm_py
from conftest import CONFIG, Cli, World
from esm_py.errors import ExistsError, SettingError

MOVES = {"movingcar", "movingvan", "cyclist", "walker", "dog"}


def extract(world: World, target: Path) -> int:
    """What `esm-cli segments` does with a directory of the simulator."""
    names = [esm_py.CLASSES.get(n, "") for n in range(max(esm_py.CLASSES) + 1)]
    voxel = CONFIG.to_dict()["segment"]["voxel"]
    identities = esm_py.Identities.numbered()
    cloud = 0
    with esm_py.SegmentSetWriter(target, places=["wood"], classes=names, voxel_m=voxel, source="test") as out:
        for visit, name in enumerate(("map", "live")):
            truth = esm_py.read_tum(world.folder / f"{name}_truth.tum")
            surveyor = esm_py.Surveyor(CONFIG, step_m=5.0)
            for sweep, pose in zip(world.recording(name, labels=True), truth.poses, strict=True):
                found = surveyor.push_sweep(sweep, pose)
                if found is None:
                    continue
                for f in found:
                    moves = f.object_class is not None and esm_py.CLASSES.get(f.object_class) in MOVES
                    known = f.object is not None and f.object != 0 and not moves
                    out.push(
                        f.points,
                        f.centroid_map,
                        object=identities.of(f.object, f.centroid_map) if known and f.object is not None else -1,
                        observation=cloud,
                        visit=visit,
                        object_class=esm_py.UNKNOWN_CLASS if f.object_class is None else f.object_class,
                        above_ground=f.above_ground,
                    )
                cloud += 1
    return len(identities)


def test_a_set_is_the_command_lines(world: World, cli: Cli, tmp_path: Path) -> None:
    objects = extract(world, tmp_path / "ours")
    config = tmp_path / "config.toml"
    config.write_text(CONFIG.to_toml())
    travel = ["--accumulate", "8", "--step", "5"]
    [report] = cli.lines("segments", world.folder, "-o", tmp_path / "cli", *travel, "--config", config)
    assert report["objects"] == objects
    meta = json.loads((tmp_path / "ours" / "meta.json").read_text())
    assert meta["segments"] == report["segments"] > 100
    for name in ("points", "offsets", "centroid_map", "object", "observation", "visit", "place", "class", "above_ground"):
        ours, theirs = (np.load(tmp_path / d / f"{name}.npy", mmap_mode="r") for d in ("ours", "cli"))
        assert ours.dtype == theirs.dtype
        # Poses go through a matrix and back.
        np.testing.assert_allclose(ours, theirs, atol=1e-5, err_msg=name)


def test_labels_as_arrays(world: World) -> None:
    by_sweep, by_array = (esm_py.Surveyor(CONFIG, step_m=2.0) for _ in range(2))
    seen = 0
    for sweep in world.recording("map", labels=True, truth=True):
        assert sweep.pose_odom_sensor is not None
        one = by_sweep.push_sweep(sweep, sweep.pose_odom_sensor)
        two = by_array.push(
            sweep.stamp,
            sweep.points,
            sweep.pose_odom_sensor,
            sweep.pose_odom_sensor,
            objects=sweep.objects,
            classes=sweep.classes,
        )
        assert (one is None) == (two is None)
        for a, b in zip(one or [], two or [], strict=True):
            assert (a.object, a.object_class, len(a)) == (b.object, b.object_class, len(b))
            seen += a.object is not None
    assert seen > 50


def test_surveyors_refuse() -> None:
    for step in (-1.0, float("nan")):
        with pytest.raises(SettingError, match="^step = .* is not allowed"):
            esm_py.Surveyor(step_m=step)
    surveyor, points, here = esm_py.Surveyor(), np.ones((4, 3)), np.eye(4)

    def push(**labels: Any) -> None:
        surveyor.push(0.0, points, here, here, **labels)

    cases: list[tuple[type[Exception], str, dict[str, Any]]] = [
        (ValueError, r"objects must have shape \(4,\)", {"objects": np.ones(3, int)}),
        (ValueError, r"classes must have shape \(4,\)", {"objects": np.ones(4, int), "classes": np.ones(5, int)}),
        (ValueError, "objects is missing", {"classes": np.ones(4, int)}),
        (ValueError, "objects does not fit u32: item 2 is -1", {"objects": [1, 2, -1, 3]}),
        (ValueError, "classes does not fit u8: item 0 is 256", {"objects": [1] * 4, "classes": [256] * 4}),
        (TypeError, "objects must hold whole numbers", {"objects": np.ones(4)}),
    ]
    for error, words, labels in cases:
        with pytest.raises(error, match=f"^{words}"):
            push(**labels)
    with pytest.raises(TypeError):
        surveyor.push(0.0, points, here)  # type: ignore[call-arg]


def test_identities() -> None:
    identities = esm_py.Identities()
    first = identities.of(0, [0, 0, 1])
    assert identities.of(0, [0.49, 0, 1]) == first, "the paper's rule: up to 0.5 m"
    assert identities.of(0, [0.51, 0, 1]) == -1 and identities.of(0, [3.99, 0, 1]) == -1
    assert identities.of(0, [4.01, 0, 1]) not in (first, -1) and len(identities) == 2
    assert identities.of(1, np.zeros(3)) == 2
    for same, different in [(2.0, 1.0), (-1.0, 1.0), (0.5, 6.0), (float("nan"), 1.0)]:
        with pytest.raises(ValueError, match="must hold"):
            esm_py.Identities(same, different)
    with pytest.raises(ValueError, match="^centroid_map must be finite"):
        identities.of(0, [np.nan, 0, 0])


def test_sets_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "set"
    named: dict[str, Any] = {"places": ["here"], "classes": [], "voxel_m": 0.2}
    with pytest.raises(ZeroDivisionError), esm_py.SegmentSetWriter(target, **named) as out:
        out.push(np.ones((3, 3)), np.zeros(3), object=1, observation=0)
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    writer = esm_py.SegmentSetWriter(target, **named)
    cases: list[tuple[type[Exception], str, dict[str, Any]]] = [
        (ValueError, "points must hold at least one point", {"points": np.empty((0, 3))}),
        (ValueError, "place must be one of the 1 places, got 1", {"place": 1}),
        (ValueError, r"centroid_map must have shape \(3,\)", {"centroid_map": [1, 2]}),
        (OverflowError, "out of range", {"visit": 70_000}),
        (OverflowError, "too large|too big", {"object": 2**64}),
    ]
    for error, words, change in cases:
        row: dict[str, Any] = {"points": np.ones((3, 3)), "centroid_map": np.zeros(3), "object": 1, "observation": 0}
        row |= change
        with pytest.raises(error, match=words):
            writer.push(row.pop("points"), row.pop("centroid_map"), **row)
    writer.push(np.ones((3, 3)), np.zeros(3), object=-1, observation=4)
    assert writer.finish() == 1
    assert np.isnan(np.load(target / "above_ground.npy")[0]) and np.load(target / "class.npy")[0] == 255
    with pytest.raises(ValueError, match="finished"):
        writer.push(np.ones((3, 3)), np.zeros(3), object=1, observation=0)
    with pytest.raises(ExistsError, match="it exists already"):
        esm_py.SegmentSetWriter(target, **named)
    with pytest.raises(ValueError, match="voxel_m"):
        esm_py.SegmentSetWriter(tmp_path / "b", places=[], classes=[], voxel_m=-1.0)
