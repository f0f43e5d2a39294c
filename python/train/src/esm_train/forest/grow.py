"""Pairs, the forest, its limit, and its file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from safetensors.numpy import save_file

from esm_train import __version__
from esm_train.checkpoint import atomically
from esm_train.corpus import Corpus, identities
from esm_train.errors import TrainError
from esm_train.forest.features import F32, I64, KINDS, Kind, describe, pair_features
from esm_train.metrics import FAR_M, nearest_in_map
from esm_train.validation import open_corpus

TREES = 25
NEAREST = 200
"""Candidates a segment, among which the hard negatives are found: what the forest will have to judge."""
PLACE_ROWS = 1500
LEAST_SAMPLES = 20
"""Pairs a leaf; smaller leaves learn the worlds by heart and swell the file."""


@dataclass
class Side:
    """Some rows of a corpus, described."""

    corpus: Corpus
    rows: I64
    values: F32
    """The searched numbers, then the histograms."""


@dataclass
class PairSet:
    """Pairs of rows of a side, and whether they are of one object."""

    first: I64
    second: I64
    same: npt.NDArray[np.bool_]


def described(program: Path, kind: Kind, corpus: Corpus, most: int, seed: int) -> Side:
    """Whole objects of a few places, as many as hold `most` rows, described by the Rust program.

    A place gives about `PLACE_ROWS`, as many as a map may hold, so that the search confuses them as it will; the kinds
    of places (the first word of a place's name) take turns. An object brings at most four of its views.
    """
    rng = np.random.default_rng([seed, 21])
    known = identities(corpus)
    place = corpus.place[known.rows[known.starts[:-1]]]
    places = rng.permutation(np.unique(place))
    names = np.array([corpus.places[p].partition(":")[0] for p in places])
    turn = np.array([np.count_nonzero(names[:i] == names[i]) for i in range(len(places))])
    taken: list[I64] = []
    count = 0
    for p in places[np.lexsort((names, turn))]:
        enough = min(count + PLACE_ROWS, most)
        for identity in rng.permutation(np.flatnonzero(place == p)):
            if count >= enough:
                break
            views = rng.permutation(known.of(int(identity)))[:4]
            taken.append(views)
            count += len(views)
        if count >= most:
            break
    if not taken:
        raise TrainError("no object of the sets was seen twice")
    rows = np.sort(np.concatenate(taken))
    parts = [describe(program, name, corpus, rows) for name in (kind.searched, kind.histograms) if name]
    return Side(corpus, rows, np.concatenate(parts, axis=1))


def make_pairs(side: Side, searched: int, count: int, seed: int) -> PairSet:
    """`count` pairs: half of one object in two observations; a quarter that the search confuses, a quarter at random.

    Negatives are of one place and at least 20 m apart, so that no part of the same thing is among them.
    """
    rng = np.random.default_rng([seed, 22])
    corpus, rows = side.corpus, side.rows
    place, thing = corpus.place[rows], corpus.object[rows]
    where, observation = corpus.centroid_map[rows], corpus.observation[rows]
    _, name = np.unique(np.stack((place, thing), axis=1), axis=0, return_inverse=True)
    order = np.argsort(name.ravel(), kind="stable")
    starts = np.searchsorted(name.ravel()[order], np.arange(name.max() + 2))
    a: list[int] = []
    b: list[int] = []
    while len(a) < count // 2:
        group = int(rng.integers(len(starts) - 1))
        i, j = rng.choice(order[starts[group] : starts[group + 1]], 2)
        if observation[i] != observation[j]:
            a.append(i)
            b.append(j)
    positive = (np.array(a), np.array(b))
    # Neighbours as the search finds them: each number by its own spread.
    numbers = side.values[:, :searched]
    scaled = ((numbers - numbers.mean(axis=0)) / np.maximum(numbers.std(axis=0), 1e-9)).astype(np.float32)
    asked = rng.integers(len(rows), size=count // 4)
    index, _ = nearest_in_map(scaled[asked], scaled, place[asked], place, NEAREST)
    picked = index[np.arange(len(asked)), rng.integers(NEAREST, size=len(asked))]
    hard = (asked, picked)
    by_place = np.argsort(place, kind="stable")
    low, high = (np.searchsorted(place[by_place], place, side=side) for side in ("left", "right"))
    one = rng.integers(len(rows), size=count)
    random = (one, by_place[low[one] + (rng.random(count) * (high - low)[one]).astype(np.int64)])
    first, second = (np.concatenate(part) for part in zip(hard, random, strict=True))
    far = np.linalg.norm(where[first] - where[second], axis=1) >= FAR_M
    keep = np.flatnonzero(far & (second >= 0))
    is_hard = keep < len(asked)
    kept = np.concatenate((keep[is_hard], keep[~is_hard][: count - count // 2 - int(is_hard.sum())]))
    same = np.concatenate((np.ones(len(positive[0]), bool), np.zeros(len(kept), bool)))
    return PairSet(np.concatenate((positive[0], first[kept])), np.concatenate((positive[1], second[kept])), same)


def grow(
    program: Path, name: str, train: tuple[str, ...], tune: tuple[str, ...], *, rows: int, pairs: int, seed: int
) -> tuple[Any, dict[str, str], tuple[Side, PairSet, F32]]:
    """The forest, what is to be told about it, and the tuning pairs with their features.

    The limit is chosen on the tuning sets: the highest probability that still keeps nine of ten true pairs.
    """
    try:
        from sklearn.ensemble import RandomForestClassifier
    except ImportError:
        raise TrainError("scikit-learn is missing", "uv run --group peers esm-train forest ...") from None
    kind = KINDS[name]
    side = described(program, kind, open_corpus(train, "train"), rows, seed)
    searched = side.values.shape[1] if not kind.histograms else 7
    chosen = make_pairs(side, searched, pairs, seed)
    features = pair_features(side.values[chosen.first], side.values[chosen.second], searched)
    print(f"{name}: {len(side.rows)} segments, {len(features)} pairs of {features.shape[1]} numbers", file=sys.stderr)
    forest = RandomForestClassifier(
        n_estimators=TREES,
        min_samples_leaf=LEAST_SAMPLES,
        max_features="sqrt",
        random_state=seed,
        class_weight="balanced",
    ).fit(features, chosen.same)
    held = described(program, kind, open_corpus(tune, "tune"), rows // 4, seed + 1)
    judged = make_pairs(held, searched, pairs // 4, seed + 1)
    asked = pair_features(held.values[judged.first], held.values[judged.second], searched)
    probability = forest.predict_proba(asked)[:, 1]
    least = float(np.round(np.quantile(probability[judged.same], 0.1), 3))
    right = np.mean((probability >= 0.5) == judged.same)
    false = np.mean(probability[~judged.same] >= least)
    facts = {
        "least_probability": repr(least),
        "training": f"{len(features)} pairs of {len(side.rows)} segments, {TREES} trees of scikit-learn",
        "tuning": f"accuracy at 0.5 {right:.3f}; at {least} 0.900 of the true pairs stay, {false:.3f} of the others",
    }
    return forest, facts, (held, judged, asked)


def forest_tensors(forest: Any) -> dict[str, npt.NDArray[np.float32]]:
    """The trees one after the other; a leaf's feature is -1 and its split the probability."""
    columns: dict[str, list[npt.NDArray[np.float64]]] = {n: [] for n in ("feature", "split", "left", "right")}
    roots, first = [], 0
    true = list(forest.classes_).index(True)
    for estimator in forest.estimators_:
        tree = estimator.tree_
        leaf = tree.children_left < 0
        votes = tree.value[:, 0, :]
        share = votes[:, true] / votes.sum(axis=1)
        # scikit-learn asks x <= t with x in f32 and t in f64: the largest f32 that is not above t asks the same.
        split = tree.threshold.astype(np.float32)
        split = np.where(split.astype(np.float64) > tree.threshold, np.nextafter(split, np.float32(-np.inf)), split)
        columns["feature"].append(np.where(leaf, -1, tree.feature))
        columns["split"].append(np.where(leaf, share, split))
        columns["left"].append(np.where(leaf, 0, tree.children_left + first))
        columns["right"].append(np.where(leaf, 0, tree.children_right + first))
        roots.append(first)
        first += tree.node_count
    out = {name: np.concatenate(parts).astype(np.float32) for name, parts in columns.items()}
    return {"roots": np.array(roots, np.float32), **out}


def write_forest(forest: Any, name: str, features: int, facts: dict[str, str], file: Path) -> None:
    """Writes the file under a temporary name and renames it."""
    tensors = forest_tensors(forest)
    metadata = {
        "format": "esm-weights",
        "format_version": "2",
        "architecture": "pair-forest",
        "variant": name,
        "features": str(features),
        "trees": str(len(tensors["roots"])),
        "nodes": str(len(tensors["feature"])),
        "created_by": f"esm_train {__version__}",
        **facts,
    }
    atomically(file, lambda part: save_file(tensors, part, metadata=metadata))


def write_forest_golden(forest: Any, tuned: tuple[Side, PairSet, F32], count: int, file: Path) -> None:
    """Pairs of the tuning sets, half of them true, with scikit-learn's answers."""
    side, pairs, features = tuned
    true, other = np.flatnonzero(pairs.same)[: count // 2], np.flatnonzero(~pairs.same)[: count // 2]
    chosen = np.concatenate((true, other))
    tensors = {
        "live": side.values[pairs.first[chosen]],
        "map": side.values[pairs.second[chosen]],
        "features": features[chosen],
        "probability": forest.predict_proba(features[chosen])[:, 1].astype(np.float32),
    }
    plain = {name: np.ascontiguousarray(value, np.float32) for name, value in tensors.items()}
    atomically(file, lambda part: save_file(plain, part, metadata={"format": "esm-golden", "format_version": "1"}))
