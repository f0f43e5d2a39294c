"""Exceptions: every class is reached, says where and what to do, and is one of Python's own too."""

from __future__ import annotations

import contextlib
import os
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import esm_py
from conftest import World
from esm_py import errors
from weights import weights

ONE = np.ones((1, 3))


def torn(path: Path, whole: bytes, keep: int) -> Path:
    path.write_bytes(whole[:keep])
    return path


def stop(folder: Path) -> Any:
    return esm_py.simulate("train-forest", 1, folder / "stopped", scale=0.01, progress=lambda _: False)


def busy(folder: Path) -> Any:
    caught: list[BaseException] = []

    def inside(_: esm_py.Progress) -> None:
        try:
            esm_py.simulate("train-forest", 1, folder / "busy", scale=0.005)
        except errors.BusyError as error:
            caught.append(error)

    esm_py.simulate("train-forest", 1, folder / "busy", scale=0.005, progress=inside)
    raise caught[0]


CASES: dict[str, tuple[Callable[[Path, World], Any], type[Exception]]] = {
    "NonFinitePointError": (lambda p, w: esm_py.Segment(ONE * np.nan), ValueError),
    "ConfigError": (lambda p, w: esm_py.Config({"segment": {"voxel": 0.0}}), ValueError),
    "DescriptorMismatchError": (lambda p, w: w.map.check_descriptor(esm_py.Descriptor("eigen")), ValueError),
    "EmptyMapError": (lambda p, w: esm_py.MapBuilder().finish(), ValueError),
    "MapDataError": (lambda p, w: w.map.segment_points(10**9), ValueError),
    "MapFileError": (lambda p, w: esm_py.Map.open(torn(p / "a.esm", w.map_file.read_bytes(), 5000)), ValueError),
    "MissingMapError": (lambda p, w: esm_py.Map.open(p / "none.esm"), FileNotFoundError),
    "WeightsFileError": (lambda p, w: esm_py.XConv.from_bytes(weights(format_version="9")), ValueError),
    "FileError": (lambda p, w: esm_py.write_tum(p / "no\0name", [1], np.eye(4)[None]), OSError),
    "MissingFileError": (lambda p, w: esm_py.read_scan(p / "none.pcd"), FileNotFoundError),
    "MalformedError": (lambda p, w: esm_py.read_scan(torn(p / "a.bin", b"\0" * 18, 18)), ValueError),
    "UnsupportedError": (lambda p, w: esm_py.read_scan(torn(p / "a.txt", b"1 2 3", 5)), ValueError),
    "TopicError": (lambda p, w: esm_py.Recording(w.folder / "map.mcap", motion_topic="/x"), ValueError),
    "EmptyError": (lambda p, w: esm_py.Recording(p), ValueError),
    "UnknownPresetError": (lambda p, w: esm_py.Preset("mars"), ValueError),
    "ScaleError": (lambda p, w: esm_py.simulate("kitti", 1, p, scale=9.0), ValueError),
    "BusyError": (lambda p, w: busy(p), Exception),
    "InterruptedSimulationError": (lambda p, w: stop(p), Exception),
    "ExistsError": (lambda p, w: esm_py.SegmentSetWriter(p.parent, places=[], classes=[], voxel_m=0.1), FileExistsError),
    "SettingError": (lambda p, w: esm_py.Surveyor(step_m=-1.0), ValueError),
}


@pytest.mark.parametrize("name", CASES)
def test_every_class_is_reached(name: str, world: World, tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    act, also = CASES[name]
    with pytest.raises(errors.EsmError) as caught:
        act(work, world)
    error = caught.value
    assert type(error) is getattr(errors, name) and isinstance(error, also)
    assert type(error).__doc__ and str(error)
    if name not in ("ConfigError", "SettingError"):
        assert error.hint and error.hint in str(error)
    if error.path is not None:
        assert str(error).startswith(error.path.replace("\0", "")[:10])
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)


@contextlib.contextmanager
def nobody() -> Iterator[None]:
    """Root may read everything: it steps aside for a moment."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


def test_forbidden_files(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_text("")
    (tmp_path / "a.pcd").chmod(0)
    with nobody(), pytest.raises(errors.ForbiddenFileError, match="(?s)a.pcd: .*hint: check the permissions") as caught:
        esm_py.read_scan(tmp_path / "a.pcd")
    assert isinstance(caught.value, PermissionError) and caught.value.errno == 13


def test_all_classes_are_tested() -> None:
    classes = {n for n in errors.__all__ if issubclass(getattr(errors, n), errors.EsmError)}
    assert classes - set(CASES) == {"EsmError", "ForbiddenFileError"}


def test_every_variant_of_the_crates_has_a_class() -> None:
    """The enums of the crates are read from their sources: a new variant needs a class."""
    crates = Path(__file__).parents[2]
    mapping = (crates / "esm-py" / "src" / "failure.rs").read_text()
    for crate in ("esm-core", "esm-io", "esm-sim", "esm-learn"):
        source = (crates / crate / "src" / "error.rs").read_text()
        body = source[source.index("pub enum Error {") :]
        body = body[: body.index("\n}")]
        variants = re.findall(r"^    ([A-Z]\w+)(?: \{|\(|,)", body, re.MULTILINE)
        assert variants, crate
        for variant in variants:
            assert re.search(rf"\bE::{variant}\b", mapping), f"{crate}: {variant}"


def test_map_files_that_are_torn_anywhere(world: World, tmp_path: Path) -> None:
    whole = world.map_file.read_bytes()
    for keep in (0, 1, 64, 300, len(whole) // 2, len(whole) - 1):
        with pytest.raises(errors.MapFileError, match=r"(?s)a\.esm: .*hint: "):
            esm_py.Map.open(torn(tmp_path / "a.esm", whole, keep)).verify_points()
    flipped = bytearray(whole)
    flipped[-1000] ^= 1
    map = esm_py.Map.open(torn(tmp_path / "b.esm", bytes(flipped), len(flipped)))
    with pytest.raises(errors.MapFileError, match="b.esm"):
        map.verify_points()
    with pytest.raises(errors.MapFileError, match="directory"):
        esm_py.Map.open(tmp_path)
    with pytest.raises(errors.MissingFileError):
        world.map.write(tmp_path / "none" / "a.esm")
