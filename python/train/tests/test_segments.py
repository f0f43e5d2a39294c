"""Labelled segments on disk: round trip, and every way a set can be damaged."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esm_train.corpus import Corpus
from esm_train.errors import TrainError
from esm_train.segments import SegmentSet, SegmentWriter


@settings(max_examples=10, deadline=None)
@given(counts=st.lists(st.integers(1, 50), min_size=1, max_size=12), seed=st.integers(0, 1000))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, counts: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("set") / "set"
    writer = SegmentWriter(path, places=["a", "b"], classes=["tree"], voxel_m=0.2, source="test")
    clouds = [rng.normal(size=(n, 3)).astype(np.float32) for n in counts]
    for i, cloud in enumerate(clouds):
        writer.add(
            cloud,
            centroid_map=np.array([1e6 + i, 2.0, 3.0]),
            object_id=i,
            observation=2 * i + 1,
            visit=i % 2,
            place=i % 2,
            label=0 if i else 255,
            above_ground=0.5 * i,
        )
    assert not path.exists()
    writer.close()
    data = SegmentSet(path)
    data.check()
    for i, cloud in enumerate(clouds):
        assert (data.segment(i) == cloud).all()
        assert data.centroid_map[i, 0] == 1e6 + i
    assert (data.points.offset, data.points[:0].nbytes) == (128, 0)  # type: ignore[attr-defined]
    again = pickle.loads(pickle.dumps(data))
    assert isinstance(again.points, np.memmap)
    points, offsets = Corpus([data, again]).gather([len(counts), 0])
    assert (points == np.concatenate((clouds[0], clouds[0]))).all()
    assert offsets.tolist() == [0, counts[0], 2 * counts[0]]


@pytest.fixture
def copy(sets: dict[str, str], tmp_path: Path) -> Path:
    return Path(shutil.copytree(sets["map"], tmp_path / "copy"))


def overwrite(path: Path, name: str, row: int, value: object) -> None:
    array = np.load(path / f"{name}.npy")
    array[row] = value
    np.save(path / f"{name}.npy", array)


@pytest.mark.parametrize(
    ("name", "row", "value", "message"),
    [
        ("points", 5, np.nan, "points.npy: row 0: a point of the segment is not finite"),
        ("points", 5, 2e3, "points.npy: row 0: a point lies over 1 km"),
        ("place", 3, 9, "place.npy: row 3: no such place"),
        ("class", 3, 9, "class.npy: row 3: no such class"),
        ("object", 4, -2, "object.npy: row 4: below -1"),
        ("centroid_map", 2, np.inf, "centroid_map.npy: row 2: not finite"),
        ("above_ground", 2, np.inf, "above_ground.npy: row 2: infinite"),
        ("visit", 2, 7, "observation 0 occurs in several places or visits"),
    ],
)
def test_check_names_file_and_row(copy: Path, name: str, row: int, value: object, message: str) -> None:
    overwrite(copy, name, row, value)
    with pytest.raises(TrainError, match=message):
        SegmentSet(copy).check()


@pytest.mark.parametrize("value", [0, 10**12])
def test_offsets_must_ascend(copy: Path, value: int) -> None:
    overwrite(copy, "offsets", 3, value)
    with pytest.raises(TrainError, match=r"offsets\.npy: row [23]: a segment"):
        SegmentSet(copy)


def test_torn_and_foreign_files(copy: Path) -> None:
    points = copy / "points.npy"
    whole = points.read_bytes()
    points.write_bytes(whole[:-7])
    with pytest.raises(TrainError, match=r"points\.npy"):
        SegmentSet(copy)
    points.write_bytes(b"nothing of the kind")
    with pytest.raises(TrainError, match=r"points\.npy"):
        SegmentSet(copy)
    np.save(points, np.zeros((4, 3), np.float64))
    with pytest.raises(TrainError, match="expected <f4"):
        SegmentSet(copy)
    meta = json.loads((copy / "meta.json").read_text())
    (copy / "meta.json").write_text(json.dumps({**meta, "format_version": 3}))
    with pytest.raises(TrainError, match="format version 3"):
        SegmentSet(copy)
    (copy / "meta.json").unlink()
    with pytest.raises(TrainError, match=r"meta\.json is missing"):
        SegmentSet(copy)


def test_nothing_is_overwritten(copy: Path) -> None:
    with pytest.raises(TrainError, match="exists already"):
        SegmentWriter(copy, places=["a"], classes=[], voxel_m=0.2, source="")
