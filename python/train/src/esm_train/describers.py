"""What is judged: a name, and segments in, descriptors and qualities out; by PyTorch or by the Rust network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import torch

from esm_train.corpus import Corpus
from esm_train.errors import TrainError
from esm_train.inputs import describe
from esm_train.model import EsmNet, QualityHead

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

MEASURES_OF_A_RING = 4
BATCH = 2000
"""Segments given to the Rust network at once."""


class Describer(Protocol):
    """A descriptor, with a quality where it has one."""

    name: str

    def __call__(self, corpus: Corpus, rows: I64) -> tuple[F32, F64 | None]:
        """Descriptors (len(rows), dim) and qualities (len(rows),), the probability of each to match."""
        ...


@dataclass
class PyTorch:
    """The network in training's own words."""

    name: str
    model: EsmNet
    head: QualityHead
    device: torch.device

    def __call__(self, corpus: Corpus, rows: I64) -> tuple[F32, F64]:
        """As every `Describer`."""
        self.model.to(self.device)
        values = describe(self.model, corpus, rows, self.device)
        with torch.no_grad():
            quality: F64 = self.head.probability(torch.from_numpy(values)).numpy().astype(np.float64)
        return values, quality


class Core:
    """The network as robots run it, through `esm_py`: the same segments, drawn to 256 points by the core itself."""

    def __init__(self, name: str, weights: Path) -> None:
        """Opens the weights.

        Raises:
            TrainError: `esm_py` is not installed, or refuses the weights.
        """
        try:
            import esm_py
        except ImportError:
            raise TrainError("esm_py is not installed", "uv run --group core esm-train evaluate ...") from None
        self.name = name
        self._esm_py: Any = esm_py
        try:
            self._network = esm_py.XConv.open(weights)
        except esm_py.EsmError as error:
            raise TrainError(str(error)) from None

    def __call__(self, corpus: Corpus, rows: I64) -> tuple[F32, F64]:
        """As every `Describer`."""
        values: list[F32] = [np.zeros((0, self._network.dim), np.float32)]
        quality: list[F64] = [np.zeros(0)]
        for start in range(0, len(rows), BATCH):
            described = self._network.describe([self._segment(corpus, int(r)) for r in rows[start : start + BATCH]])
            values.append(np.asarray(described.values, np.float32))
            quality.append(np.asarray(described.quality, np.float64))
        return np.concatenate(values), np.concatenate(quality)

    def _segment(self, corpus: Corpus, row: int) -> Any:
        height = float(corpus.above_ground[row])
        return self._esm_py.Segment(
            corpus.segment(row),
            above_ground=None if np.isnan(height) else height,
            rings=corpus.rings[row].reshape(-1, MEASURES_OF_A_RING),
        )
