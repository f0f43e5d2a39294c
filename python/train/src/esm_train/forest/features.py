"""What a forest is asked about a pair of segments, from the numbers the Rust descriptors give."""

from __future__ import annotations

import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from esm_train.corpus import Corpus
from esm_train.errors import TrainError

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

BINS = 64
LEAST = np.float32(1e-6)


@dataclass(frozen=True)
class Kind:
    """One of the peers."""

    name: str
    searched: str
    """Descriptor whose numbers are searched by and give the differences."""
    histograms: str
    """Descriptor whose histograms are intersected; empty: none."""


KINDS = {k.name: k for k in (Kind("segmatch", "eigen", "esf"), Kind("nsm", "gestalt", ""))}


def describe(program: Path, name: str, corpus: Corpus, rows: I64) -> F32:
    """Rows of the descriptor `name` by the example program `describe` of esm-core."""
    points, offsets = corpus.gather(rows)
    counts = np.diff(offsets).astype("<u4")
    data = struct.pack("<I", len(rows)) + counts.tobytes() + points.astype("<f4").tobytes()
    try:
        done = subprocess.run([str(program), name], input=data, capture_output=True, check=False)
    except OSError as error:
        raise TrainError(f"{program}: {error}", "cargo build --release -p esm-core --example describe") from None
    if done.returncode:
        raise TrainError(f"{program} {name}: {done.stderr.decode(errors='replace').strip()}")
    (dim,) = struct.unpack("<I", done.stdout[:4])
    return np.frombuffer(done.stdout, "<f4", offset=4).reshape(len(rows), dim)


def pair_features(live: F32, mapped: F32, searched: int) -> F32:
    """Features of pairs: `searched` numbers of each side, then histograms of 64 bins where there are any."""
    a, b = live[:, :searched], mapped[:, :searched]
    d = np.abs(a - b)
    parts = [d, d / np.maximum(np.abs(b), LEAST), d / np.maximum(np.abs(a), LEAST), np.abs(a), np.abs(b)]
    if live.shape[1] > searched:
        both = np.minimum(live[:, searched:], mapped[:, searched:])
        parts.append(both.reshape(len(live), -1, BINS).sum(axis=2))
    return np.concatenate(parts, axis=1).astype(np.float32)
