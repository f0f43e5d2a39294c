"""SegMap as one of those that `esm-train evaluate` judges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esm_train.corpus import Corpus
from esm_train.metrics import F32, I64
from esm_train.segmap.data import grids_of
from esm_train.segmap.model import DESCRIPTOR, SegMapNet
from esm_train.segmap.trainer import describe_grids

BATCH = 256


@dataclass
class SegMap:
    """The encoder; it has no quality."""

    name: str
    model: SegMapNet

    def __call__(self, corpus: Corpus, rows: I64) -> tuple[F32, None]:
        """As every `Describer`."""
        parts = [describe_grids(self.model, grids_of(corpus, rows[i : i + BATCH])) for i in range(0, len(rows), BATCH)]
        return np.concatenate([np.zeros((0, DESCRIPTOR), np.float32), *parts]), None
