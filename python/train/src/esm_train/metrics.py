"""Retrieval and separation: recall of the true counterpart in the whole map, ROC curves, reliability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esm_train.corpus import Corpus

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

FAR_M = 20.0
"""A negative lies at least this far from the object (SegMap's protocol)."""

HARD_TOLERANCE = 0.2
"""Height and both horizontal extents of a hard negative differ by less than this share of the query's."""


@dataclass
class Sides:
    """A map and live segments of the same places, and what tells which are the same."""

    map: Corpus
    live: Corpus
    map_rows: I64
    live_rows: I64
    truth: str = "auto"
    """object, position, or auto: by object where the live segment has one, else by position."""
    radius_m: float = 0.7

    def __post_init__(self) -> None:
        places = {name: number for number, name in enumerate(sorted({*self.map.places, *self.live.places}))}
        self.map_place = np.array([places[p] for p in self.map.places])[self.map.place[self.map_rows]]
        self.live_place = np.array([places[p] for p in self.live.places])[self.live.place[self.live_rows]]
        self.map_xyz = self.map.centroid_map[self.map_rows]
        self.live_xyz = self.live.centroid_map[self.live_rows]
        self.map_object = self.map.object[self.map_rows]
        self.live_object = self.live.object[self.live_rows]
        if self.truth == "object":
            self.by_object = np.ones(len(self.live_rows), bool)
        elif self.truth == "position":
            self.by_object = np.zeros(len(self.live_rows), bool)
        else:
            self.by_object = self.live_object >= 0
        self._things: dict[tuple[int, int], list[int]] = {}
        for row in np.flatnonzero(self.map_object >= 0):
            self._things.setdefault((int(self.map_place[row]), int(self.map_object[row])), []).append(int(row))
        # Rows of each place by x: a live segment's neighbours in position are in a window of it.
        self._by_x: dict[int, I64] = {}
        for place in np.unique(self.map_place):
            rows = np.flatnonzero(self.map_place == place)
            self._by_x[int(place)] = rows[np.argsort(self.map_xyz[rows, 0], kind="stable")]

    def distance(self, live: I64, found: I64) -> F64:
        """Metres between live segments and map segments (indices that broadcast); infinite across places."""
        d = np.linalg.norm(self.map_xyz[found] - self.live_xyz[live], axis=-1)
        return np.where(self.map_place[found] == self.live_place[live], d, np.inf)

    def same(self, live: I64, found: I64) -> Bool:
        """Whether map segments are the true counterparts of live segments (indices that broadcast)."""
        near = self.distance(live, found) <= self.radius_m
        place = self.map_place[found] == self.live_place[live]
        thing = place & (self.map_object[found] == self.live_object[live]) & (self.live_object[live] >= 0)
        out: Bool = np.where(self.by_object[live], thing, near)
        return out

    def counterparts(self, live: int) -> I64:
        """Map segments that are the same as a live one, ascending."""
        place = int(self.live_place[live])
        if self.by_object[live]:
            return np.array(self._things.get((place, int(self.live_object[live])), []), dtype=np.int64)
        rows = self._by_x.get(place, np.zeros(0, np.int64))
        x, window = self.live_xyz[live, 0], self.map_xyz[rows, 0]
        near = rows[np.searchsorted(window, x - self.radius_m) : np.searchsorted(window, x + self.radius_m, "right")]
        return np.sort(near[self.same(np.full_like(near, live), near)])

    def judged(self) -> I64:
        """Live segments that have a counterpart in the map."""
        found = [i for i in range(len(self.live_rows)) if len(self.counterparts(i))]
        return np.array(found, dtype=np.int64)


def nearest_in_map(live: F32, mapped: F32, live_place: I64, map_place: I64, k: int) -> tuple[I64, F32]:
    """(Q, k) nearest map descriptors within the query's place, ascending; ties by index; -1 and inf where missing."""
    index = np.full((len(live), k), -1, np.int64)
    distance = np.full((len(live), k), np.inf, np.float32)
    for place in np.unique(live_place):
        rows = np.flatnonzero(map_place == place)
        queries = np.flatnonzero(live_place == place)
        if not len(rows):
            continue
        target = mapped[rows].astype(np.float64)
        norms = (target * target).sum(axis=1)
        take = min(k, len(rows))
        for start in range(0, len(queries), 256):
            block = queries[start : start + 256]
            q = live[block].astype(np.float64)
            squared = np.maximum((q * q).sum(axis=1)[:, None] + norms - 2.0 * q @ target.T, 0.0)
            near = np.sort(np.argpartition(squared, take - 1, axis=1)[:, :take], axis=1)
            near = np.take_along_axis(
                near, np.argsort(np.take_along_axis(squared, near, axis=1), axis=1, kind="stable"), axis=1
            )
            index[block, :take] = rows[near]
            distance[block, :take] = np.sqrt(np.take_along_axis(squared, near, axis=1))
    return index, distance


def recall_at(sides: Sides, judged: I64, index: I64, ks: tuple[int, ...]) -> dict[int, float]:
    """Share of the judged live segments with a true counterpart among the k nearest; `index` has their rows."""
    right = (index >= 0) & sides.same(judged[:, None], np.maximum(index, 0))
    return {k: float(right[:, :k].any(axis=1).mean()) if len(judged) else float("nan") for k in ks}


@dataclass(frozen=True)
class Roc:
    """A curve and its area."""

    false_positive: F64
    true_positive: F64
    auc: float


def roc(positive: F64, negative: F64) -> Roc:
    """From the scores of true and false pairs, higher = more alike; ties count half in the area."""
    if not len(positive) or not len(negative):
        return Roc(np.array([0.0, 1.0]), np.array([0.0, 1.0]), float("nan"))
    scores = np.concatenate((positive, negative))
    truth = np.concatenate((np.ones(len(positive)), np.zeros(len(negative))))
    order = np.argsort(-scores, kind="stable")
    scores, truth = scores[order], truth[order]
    last = np.append(scores[1:] != scores[:-1], True)
    tp = np.concatenate(([0.0], np.cumsum(truth)[last])) / len(positive)
    fp = np.concatenate(([0.0], np.cumsum(1.0 - truth)[last])) / len(negative)
    return Roc(fp, tp, float(np.trapezoid(tp, fp)))


@dataclass(frozen=True)
class Pairs:
    """Pairs of a live segment (index) and a map segment (index)."""

    live: I64
    map: I64


def positive_pairs(sides: Sides, judged: I64, seed: int) -> Pairs:
    """One counterpart of each judged live segment, at random."""
    rng = np.random.default_rng([seed, 10])
    found = [int(rng.choice(sides.counterparts(int(i)))) for i in judged]
    return Pairs(judged, np.array(found, dtype=np.int64))


def random_negatives(sides: Sides, judged: I64, seed: int) -> Pairs:
    """As many pairs of objects at least 20 m apart, within a place."""
    rng = np.random.default_rng([seed, 11])
    live: list[int] = []
    found: list[int] = []
    for i in judged:
        for candidate in rng.integers(0, len(sides.map_rows), 64):
            d = float(sides.distance(np.array(i), np.array(candidate)))
            if np.isfinite(d) and d >= FAR_M:
                live.append(int(i))
                found.append(int(candidate))
                break
    return Pairs(np.array(live, dtype=np.int64), np.array(found, dtype=np.int64))


def hard_negatives(sides: Sides, judged: I64, live_lengths: F64, map_lengths: F64, seed: int) -> Pairs:
    """For each live segment a random map segment over 20 m away that is alike in height and both extents."""
    rng = np.random.default_rng([seed, 12])
    live: list[int] = []
    found: list[int] = []
    every = np.arange(len(sides.map_rows))
    for i in judged:
        own = live_lengths[i, 3:]
        alike = (np.abs(map_lengths[:, 3:] - own) < HARD_TOLERANCE * own).all(axis=1)
        d = sides.distance(np.full_like(every, i), every)
        candidates = np.flatnonzero(alike & (d > FAR_M) & np.isfinite(d))
        if len(candidates):
            live.append(int(i))
            found.append(int(rng.choice(candidates)))
    return Pairs(np.array(live, dtype=np.int64), np.array(found, dtype=np.int64))


def pair_scores(live: F32, mapped: F32, pairs: Pairs) -> F64:
    """1 / L2 distance of the descriptors of each pair; huge where they coincide."""
    d = np.linalg.norm(live[pairs.live].astype(np.float64) - mapped[pairs.map].astype(np.float64), axis=1)
    scores: F64 = 1.0 / np.maximum(d, 1e-12)
    return scores


@dataclass(frozen=True)
class Reliability:
    """Bins of equal count: mean predicted probability, share that came true, count; and the calibration error."""

    predicted: F64
    observed: F64
    count: I64
    error: float


def reliability(probability: F64, outcome: Bool, bins: int = 10) -> Reliability:
    """How far a predicted probability is to be believed."""
    order = np.argsort(probability, kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part)]
    predicted = np.array([probability[p].mean() for p in parts])
    observed = np.array([outcome[p].mean() for p in parts])
    count = np.array([len(p) for p in parts])
    error = float((np.abs(predicted - observed) * count).sum() / max(count.sum(), 1))
    return Reliability(predicted, observed, count, error)
