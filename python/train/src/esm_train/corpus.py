"""Several sets as one body of labelled segments, and the batches drawn from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esm_train.config import BatchConfig
from esm_train.errors import TrainError
from esm_train.segments import SegmentSet
from esm_train.sizes import lengths

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


class Corpus:
    """Rows of several sets, numbered through; all but the points is held in memory."""

    def __init__(self, sets: Sequence[SegmentSet]) -> None:
        self.sets = list(sets)
        starts = np.cumsum([0, *(len(s) for s in sets)])
        self.starts: I64 = starts.astype(np.int64)
        names = sorted({name for s in sets for name in s.meta.places})
        labels = sorted({name for s in sets for name in s.meta.classes})
        self.places = names
        self.classes = labels
        place = [np.array([names.index(p) for p in s.meta.places])[s.place] for s in sets]
        self.place: I64 = np.concatenate(place).astype(np.int64)
        # The last entry serves the unknown class, 255 or any beyond the list.
        label = [
            np.array([*(labels.index(c) for c in s.meta.classes), -1])[np.minimum(s.label, len(s.meta.classes))]
            for s in sets
        ]
        self.label: I64 = np.concatenate(label).astype(np.int64)
        self.object: I64 = np.concatenate([np.asarray(s.object) for s in sets])
        self.observation: I64 = np.concatenate(
            [np.asarray(s.observation, np.int64) + (number << 32) for number, s in enumerate(sets)]
        )
        self.visit: I64 = np.concatenate([np.asarray(s.visit, np.int64) for s in sets])
        self.centroid_map: npt.NDArray[np.float64] = np.concatenate([np.asarray(s.centroid_map) for s in sets])
        self.above_ground: F32 = np.concatenate([np.asarray(s.above_ground) for s in sets])
        self.rings: F32 = np.concatenate([np.asarray(s.rings) for s in sets])
        self.counts: I64 = np.concatenate([np.diff(s.offsets).astype(np.int64) for s in sets])

    def __len__(self) -> int:
        return int(self.starts[-1])

    def segment(self, row: int) -> F32:
        """Points (n, 3) in metres about the segment's centroid."""
        number = int(np.searchsorted(self.starts, row, side="right")) - 1
        return self.sets[number].segment(row - int(self.starts[number]))

    def gather(self, rows: Sequence[int] | I64) -> tuple[F32, I64]:
        """Points of several segments one after the other, and their offsets."""
        parts = [self.segment(int(row)) for row in rows]
        offsets = np.concatenate(([0], np.cumsum([len(p) for p in parts]))).astype(np.int64)
        return np.concatenate(parts) if parts else np.zeros((0, 3), np.float32), offsets

    def lengths(self, rows: I64) -> npt.NDArray[np.float64]:
        """(len(rows), 6) metric lengths, read in pieces."""
        pieces = [lengths(*self.gather(rows[i : i + 1024])) for i in range(0, len(rows), 1024)]
        return np.concatenate(pieces) if pieces else np.zeros((0, 6))


@dataclass(frozen=True)
class Identities:
    """Objects seen in at least two observations: their rows, grouped."""

    rows: I64
    """Rows, sorted by identity."""
    starts: I64
    """Identity i has `rows[starts[i] : starts[i + 1]]`."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    def of(self, identity: int) -> I64:
        """Rows of an identity."""
        return self.rows[self.starts[identity] : self.starts[identity + 1]]


def identities(corpus: Corpus, among: I64 | None = None) -> Identities:
    """Groups the rows (all, or some) with a known object by (place, object), less those of one observation only."""
    rows = np.flatnonzero(corpus.object >= 0) if among is None else among[corpus.object[among] >= 0]
    order = rows[np.lexsort((rows, corpus.observation[rows], corpus.object[rows], corpus.place[rows]))]
    place, thing = corpus.place[order], corpus.object[order]
    new = np.ones(len(order), bool)
    new[1:] = (place[1:] != place[:-1]) | (thing[1:] != thing[:-1])
    group = np.cumsum(new) - 1
    seen = np.ones(len(order), bool)
    seen[1:] = new[1:] | (corpus.observation[order][1:] != corpus.observation[order][:-1])
    observations = np.bincount(group, weights=seen) if len(order) else np.zeros(0)
    keep = observations[group] >= 2 if len(order) else np.zeros(0, bool)
    kept, counts = order[keep], np.bincount(group, minlength=1)[observations >= 2] if len(order) else np.zeros(0)
    starts = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    return Identities(kept, starts)


FULLNESS_FACTOR = 2.0
"""Two views are alike in fullness when neither has more points than the other by more than this."""


class BatchSampler:
    """The rows of a batch, a function of seed, step and rank alone, so that a training resumes at any step."""

    def __init__(self, corpus: Corpus, config: BatchConfig, seed: int, among: I64 | None = None) -> None:
        self.corpus = corpus
        self.config = config
        self.seed = seed
        self.identities = identities(corpus, among)
        if len(self.identities) < config.classes:
            raise TrainError(
                f"{len(self.identities)} objects were seen in two observations or more, a batch takes {config.classes}",
                "give more data, or lower batch.classes",
            )
        first = self.identities.rows[self.identities.starts[:-1]]
        self._place = corpus.place[first]
        self._places = np.unique(self._place)
        self._extents: npt.NDArray[np.float64] | None = None
        if config.hard_fraction > 0.0:
            self._extents = np.log(corpus.lengths(first)[:, 3:] + 0.1)
            self._labels = corpus.label[first]

    def rows(self, step: int, rank: int = 0) -> I64:
        """(classes * per_class,) rows; those of one object follow each other."""
        rng = np.random.default_rng([self.seed, 1, step, rank])
        chosen = self._classes(rng)
        return np.concatenate([self._members(identity, rng) for identity in chosen])

    def _classes(self, rng: np.random.Generator) -> list[int]:
        wanted = self.config.classes
        chosen: dict[int, None] = {}
        among = np.arange(len(self.identities))
        if self.config.places:
            # As many places as give enough objects, in random order.
            places = rng.permutation(self._places)
            held = np.cumsum([np.count_nonzero(self._place == p) for p in places])
            enough = max(self.config.places, int(np.searchsorted(held, wanted)) + 1)
            among = np.flatnonzero(np.isin(self._place, places[:enough]))
        hard = round(wanted * self.config.hard_fraction)
        while self._extents is not None and len(chosen) < hard:
            anchor = int(among[rng.integers(len(among))])
            chosen.setdefault(anchor)
            near = np.abs(self._extents[among] - self._extents[anchor]).max(axis=1) < np.log1p(
                self.config.hard_tolerance
            )
            alike = among[near & (self._labels[among] == self._labels[anchor])]
            alike = alike[alike != anchor]
            size = min(self.config.hard_group - 1, len(alike), wanted - len(chosen))
            for identity in rng.choice(alike, size, replace=False) if size > 0 else ():
                chosen.setdefault(int(identity))
        for identity in rng.permutation(among):
            if len(chosen) >= wanted:
                break
            chosen.setdefault(int(identity))
        return list(chosen)[:wanted]

    def _members(self, identity: int, rng: np.random.Generator) -> I64:
        """`per_class` rows of distinct observations, where there are enough of them."""
        rows = rng.permutation(self.identities.of(identity))
        _, first = np.unique(self.corpus.observation[rows], return_index=True)
        rows = rows[np.sort(first)]
        if rng.random() < self.config.across_visits:
            # One row of each visit first: the pair then spans visits where there are several.
            _, first = np.unique(self.corpus.visit[rows], return_index=True)
            leading = np.sort(first)
            rows = np.concatenate((rows[leading], np.delete(rows, leading)))
        if rng.random() < self.config.alike_fullness:
            # Those that hold about as many points as the first one come next, in the order they had.
            counts = self.corpus.counts[rows].astype(np.float64)
            alike = np.abs(np.log(counts / counts[0])) < np.log(FULLNESS_FACTOR)
            rows = np.concatenate((rows[alike], rows[~alike]))
        return rows[np.arange(self.config.per_class) % len(rows)]
