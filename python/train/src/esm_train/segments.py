"""Labelled segments on disk (DATA.md): reader, writer, validator."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esm_train.errors import TrainError
from esm_train.plan import CONTEXT

F32 = npt.NDArray[np.float32]

FORMAT = "esm-segments"
VERSION = 2
UNKNOWN_OBJECT = -1
UNKNOWN_CLASS = 255
MAX_POINTS = 100_000

COLUMNS: dict[str, tuple[str, tuple[int, ...]]] = {
    "centroid_map": ("<f8", (3,)),
    "object": ("<i8", ()),
    "observation": ("<u4", ()),
    "visit": ("<u2", ()),
    "place": ("<u2", ()),
    "class": ("<u1", ()),
    "above_ground": ("<f4", ()),
    "rings": ("<f4", (CONTEXT,)),
}
"""Arrays with one row a segment: dtype and shape of a row."""


@dataclass(frozen=True)
class Meta:
    """What `meta.json` says."""

    segments: int
    points: int
    places: tuple[str, ...]
    classes: tuple[str, ...]
    voxel_m: float
    source: str


class SegmentSet:
    """One directory of labelled segments, mapped into memory."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.meta = _read_meta(path)
        self.points: F32 = _open(path, "points", "<f4", (3,), self.meta.points)
        # The same mapping without np.memmap's overhead on every slice.
        self._plain: F32 = self.points.view(np.ndarray)
        self.offsets: npt.NDArray[np.uint64] = _open(path, "offsets", "<u8", (), self.meta.segments + 1)
        columns = {name: _open(path, name, *kind, self.meta.segments) for name, kind in COLUMNS.items()}
        self.centroid_map: npt.NDArray[np.float64] = columns["centroid_map"]
        self.object: npt.NDArray[np.int64] = columns["object"]
        self.observation: npt.NDArray[np.uint32] = columns["observation"]
        self.visit: npt.NDArray[np.uint16] = columns["visit"]
        self.place: npt.NDArray[np.uint16] = columns["place"]
        self.label: npt.NDArray[np.uint8] = columns["class"]
        self.above_ground: F32 = columns["above_ground"]
        self.rings: F32 = columns["rings"]
        _check_offsets(path, self.offsets, self.meta.points)

    def __len__(self) -> int:
        return self.meta.segments

    def __reduce__(self) -> tuple[type[SegmentSet], tuple[Path]]:
        """Workers map the files anew instead of receiving a copy."""
        return SegmentSet, (self.path,)

    def segment(self, row: int) -> F32:
        """Points (n, 3) of a segment in metres about its centroid; a view of the mapped file."""
        return self._plain[int(self.offsets[row]) : int(self.offsets[row + 1])]

    def gather(self, rows: Sequence[int] | npt.NDArray[np.int64]) -> tuple[F32, npt.NDArray[np.int64]]:
        """The points of several segments one after the other, and their offsets."""
        parts = [self.segment(int(row)) for row in rows]
        offsets = np.concatenate(([0], np.cumsum([len(p) for p in parts]))).astype(np.int64)
        points = np.concatenate(parts) if parts else np.zeros((0, 3), np.float32)
        return points, offsets

    def check(self) -> None:
        """Reads everything once; raises at the first row that breaks a rule of DATA.md."""
        n = len(self)
        _first_bad(self.path, "place", self.place >= len(self.meta.places), "no such place in meta.json")
        known = (self.label < len(self.meta.classes)) | (self.label == UNKNOWN_CLASS)
        _first_bad(self.path, "class", ~known, "no such class in meta.json; 255 says unknown")
        _first_bad(self.path, "object", self.object < UNKNOWN_OBJECT, "below -1")
        _first_bad(self.path, "centroid_map", ~np.isfinite(self.centroid_map).all(axis=1), "not finite")
        _first_bad(self.path, "above_ground", np.isinf(np.asarray(self.above_ground)), "infinite; NaN says unknown")
        _first_bad(self.path, "rings", ~np.isfinite(self.rings).all(axis=1), "not finite")
        for start in range(0, n, 1024):
            rows = np.arange(start, min(start + 1024, n))
            points, offsets = self.gather(rows)
            low = np.logical_and.reduceat(np.isfinite(points).all(axis=1), offsets[:-1])
            _first_bad(self.path, "points", ~low, "a point of the segment is not finite", start)
            far = np.maximum.reduceat(np.abs(points).max(axis=1), offsets[:-1]) > 1000.0
            _first_bad(self.path, "points", far, "a point lies over 1 km from the segment's centroid", start)
        _check_observations(self)


def _check_observations(data: SegmentSet) -> None:
    """One observation number is one cloud: of one place and one visit."""
    keys = np.stack((data.observation, data.place, data.visit), axis=1).astype(np.int64)
    unique = np.unique(keys, axis=0)
    _, counts = np.unique(unique[:, 0], return_counts=True)
    if (counts > 1).any():
        number = int(unique[np.searchsorted(unique[:, 0], np.unique(unique[:, 0])[counts > 1][0]), 0])
        raise TrainError(
            f"{data.path / 'observation.npy'}: observation {number} occurs in several places or visits",
            "number the live clouds of a directory consecutively",
        )


def _first_bad(path: Path, name: str, bad: npt.ArrayLike, why: str, first_row: int = 0) -> None:
    rows = np.flatnonzero(np.asarray(bad))
    if rows.size:
        raise TrainError(f"{path / (name + '.npy')}: row {first_row + int(rows[0])}: {why}", "see DATA.md")


def _read_meta(path: Path) -> Meta:
    file = path / "meta.json"
    try:
        raw = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise TrainError(
            f"{path}: no directory of labelled segments, meta.json is missing",
            "meta.json is written last: the writer may have been interrupted",
        ) from None
    except (OSError, ValueError) as error:
        raise TrainError(f"{file}: {error}") from None
    if not isinstance(raw, dict) or raw.get("format") != FORMAT:
        raise TrainError(f"{file}: not of the format {FORMAT!r}")
    if raw.get("format_version") != VERSION:
        raise TrainError(
            f"{file}: format version {raw.get('format_version')!r}, this program reads {VERSION}",
            "write the segments anew with the present version",
        )
    try:
        meta = Meta(
            segments=int(raw["segments"]),
            points=int(raw["points"]),
            places=tuple(str(p) for p in raw["places"]),
            classes=tuple(str(c) for c in raw["classes"]),
            voxel_m=float(raw["voxel_m"]),
            source=str(raw["source"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise TrainError(f"{file}: field missing or of the wrong type: {error}", "see DATA.md") from None
    if meta.segments < 1 or meta.points < meta.segments or not meta.places:
        raise TrainError(f"{file}: {meta.segments} segments, {meta.points} points, {len(meta.places)} places")
    return meta


def _open(path: Path, name: str, dtype: str, row: tuple[int, ...], length: int) -> Any:
    file = path / f"{name}.npy"
    try:
        array = np.load(file, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise TrainError(f"{file}: {error}", "the set is incomplete or damaged: write it anew") from None
    if array.dtype != np.dtype(dtype) or array.shape != (length, *row) or not array.flags.c_contiguous:
        raise TrainError(
            f"{file}: {array.dtype.str} {array.shape}, expected {dtype} {(length, *row)} by meta.json",
            "the set is incomplete or damaged: write it anew",
        )
    return array


def _check_offsets(path: Path, offsets: npt.NDArray[np.uint64], points: int) -> None:
    file = path / "offsets.npy"
    if offsets[0] != 0 or int(offsets[-1]) != points:
        raise TrainError(f"{file}: runs from {offsets[0]} to {offsets[-1]}, expected 0 to {points}")
    bad = np.flatnonzero(offsets[1:] <= offsets[:-1])
    if bad.size:
        raise TrainError(f"{file}: row {int(bad[0])}: a segment without points")
    bad = np.flatnonzero(offsets[1:] - offsets[:-1] > MAX_POINTS)
    if bad.size:
        raise TrainError(f"{file}: row {int(bad[0])}: a segment of over {MAX_POINTS} points")


class SegmentWriter:
    """Writes a set piece by piece; nothing appears at the target before `close`."""

    def __init__(
        self,
        path: Path,
        *,
        places: Sequence[str],
        classes: Sequence[str],
        voxel_m: float,
        source: str,
        overwrite: bool = False,
    ) -> None:
        if path.exists() and not overwrite:
            raise TrainError(f"{path}: exists already", "remove it, or write elsewhere")
        self.path = path
        self.part = path.with_name(path.name + ".part")
        self._about = {"places": list(places), "classes": list(classes), "voxel_m": voxel_m, "source": source}
        shutil.rmtree(self.part, ignore_errors=True)
        self.part.mkdir(parents=True)
        self._kinds = {"points": ("<f4", (3,)), "offsets": ("<u8", ()), **COLUMNS}
        self._files = {name: (self.part / f"{name}.npy").open("w+b") for name in self._kinds}
        self._rows = dict.fromkeys(self._kinds, 0)
        for name in self._kinds:
            self._files[name].write(self._header(name))
        self._put("offsets", np.zeros(1, "<u8"))

    def _header(self, name: str) -> bytes:
        dtype, row = self._kinds[name]
        shape = ", ".join([f"{self._rows[name]:>20}", *(str(r) for r in row)])
        text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({shape},), }}"
        return b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + text.ljust(117).encode() + b"\n"

    def _put(self, name: str, rows: npt.NDArray[Any]) -> None:
        dtype, _ = self._kinds[name]
        self._files[name].write(np.ascontiguousarray(rows, dtype=dtype).tobytes())
        self._rows[name] += len(rows)

    def add(
        self,
        points: F32,
        *,
        centroid_map: npt.NDArray[np.float64],
        object_id: int,
        observation: int,
        visit: int = 0,
        place: int = 0,
        label: int = UNKNOWN_CLASS,
        above_ground: float = float("nan"),
        rings: F32 | None = None,
    ) -> None:
        """Appends one segment: points (n, 3) in metres about `centroid_map`; without `rings` it is alone."""
        if not 1 <= len(points) <= MAX_POINTS:
            raise TrainError(f"{self.path}: a segment of {len(points)} points")
        self._put("points", points)
        self._put("offsets", np.array([self._rows["points"]]))
        row = {
            "centroid_map": centroid_map,
            "object": object_id,
            "observation": observation,
            "visit": visit,
            "place": place,
            "class": label,
            "above_ground": above_ground,
            "rings": np.zeros(CONTEXT, np.float32) if rings is None else rings,
        }
        for name, value in row.items():
            self._put(name, np.asarray(value)[None])

    def close(self) -> None:
        """Patches the headers, writes `meta.json`, syncs and renames."""
        for name, file in self._files.items():
            file.seek(0)
            file.write(self._header(name))
            file.flush()
            os.fsync(file.fileno())
            file.close()
        meta = {
            "format": FORMAT,
            "format_version": VERSION,
            "segments": self._rows["object"],
            "points": self._rows["points"],
            **self._about,
        }
        with (self.part / "meta.json").open("w", encoding="utf-8") as text:
            json.dump(meta, text, indent=1)
            text.flush()
            os.fsync(text.fileno())
        shutil.rmtree(self.path, ignore_errors=True)
        self.part.rename(self.path)
