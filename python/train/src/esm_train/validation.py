"""Recall on held-out sets while training, and the word on convergence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from esm_train.corpus import Corpus
from esm_train.errors import TrainError
from esm_train.inputs import Inputs, describe_inputs, inference_inputs
from esm_train.metrics import F32, I64, Sides, nearest_in_map, recall_at
from esm_train.model import EsmNet
from esm_train.plan import Plan
from esm_train.segments import SegmentSet

CONVERGED_GAIN = 0.01
"""Recall@25 that the last quarter of a training must gain for it to go on."""


def open_corpus(paths: tuple[str, ...], what: str) -> Corpus:
    """The sets of a configuration key; a directory of sets stands for all of them."""
    if not paths:
        raise TrainError(f"{what}: no directory of segments is named", f"set {what} in the configuration")
    return Corpus([SegmentSet(directory) for path in paths for directory in sets_under(Path(path))])


def sets_under(path: Path) -> list[Path]:
    """The set itself, or the sets right under a directory that is none, by name."""
    if (path / "meta.json").exists() or not path.is_dir():
        return [path]
    return sorted(p.parent for p in path.glob("*/meta.json")) or [path]


def open_rows(paths: tuple[str, ...], what: str) -> tuple[Corpus, I64]:
    """Sets and the rows of them that are meant: `DIR@N` is what visit N of the sets of DIR saw, DIR everything."""
    corpora = [(open_corpus((directory,), what), visit) for directory, visit in map(_of_visit, paths)]
    corpus = Corpus([s for c, _ in corpora for s in c.sets]) if corpora else open_corpus(paths, what)
    wanted = np.concatenate([np.full(len(c), -1 if visit is None else visit) for c, visit in corpora])
    rows = np.flatnonzero((wanted < 0) | (corpus.visit == wanted))
    if not len(rows):
        raise TrainError(f"{what}: {', '.join(paths)}: no segments of that visit")
    return corpus, rows


def _of_visit(path: str) -> tuple[str, int | None]:
    directory, at, number = path.rpartition("@")
    return (directory, int(number)) if at and number.isdecimal() and not Path(path).exists() else (path, None)


def open_sides(
    map_paths: tuple[str, ...], live_paths: tuple[str, ...], what: str, truth: str = "auto", radius_m: float = 0.7
) -> Sides:
    """All segments of a map and of live sets, each `DIR` or `DIR@VISIT`."""
    (mapped, map_rows), (live, live_rows) = open_rows(map_paths, f"{what}.map"), open_rows(live_paths, f"{what}.live")
    return Sides(mapped, live, map_rows, live_rows, truth, radius_m)


class Validation:
    """Held-out segments, prepared once; all counterparts of the judged ones are among the map's."""

    def __init__(self, sides: Sides, plan: Plan, *, max_live: int, max_map: int, lists: bool) -> None:
        self.sides = judged_part(sides, max_live, max_map)
        self.live_inputs: Inputs = inference_inputs(sides.live, self.sides.live_rows, plan, lists)
        self.map_inputs: Inputs = inference_inputs(sides.map, self.sides.map_rows, plan, lists)

    def __call__(self, model: EsmNet, device: torch.device) -> dict[str, float]:
        """Recall@1 and recall@25 of the judged segments."""
        live = describe_inputs(model, self.live_inputs, device)
        return recall_of(self.sides, live, describe_inputs(model, self.map_inputs, device))


def judged_part(sides: Sides, max_live: int, max_map: int) -> Sides:
    """At most `max_live` live segments with a counterpart, in a fixed random order, and a map that holds all those."""
    rng = np.random.default_rng(7)
    live = rng.permutation(len(sides.live_rows))
    counterparts: list[I64] = []
    kept: list[int] = []
    for row in live:
        found = sides.counterparts(int(row))
        if len(found):
            kept.append(int(row))
            counterparts.append(found)
        if len(kept) == max_live:
            break
    if not kept:
        raise TrainError(
            "validation: no live segment has a counterpart in the map", "do the sets name the same places?"
        )
    needed = np.unique(np.concatenate(counterparts))
    others = np.setdiff1d(np.arange(len(sides.map_rows)), needed)
    others = rng.permutation(others)[: max(0, max_map - len(needed))]
    map_rows = sides.map_rows[np.sort(np.concatenate((needed, others)))]
    return Sides(sides.map, sides.live, map_rows, sides.live_rows[kept], sides.truth)


def recall_of(sides: Sides, live: F32, mapped: F32) -> dict[str, float]:
    """Recall@1 and recall@25 of all live segments by their descriptors."""
    index, _ = nearest_in_map(live, mapped, sides.live_place, sides.map_place, 25)
    recall = recall_at(sides, np.arange(len(live)), index, (1, 25))
    return {f"recall@{k}": value for k, value in recall.items()}


def converged(history: list[dict[str, float]]) -> bool:
    """Whether recall@25 gained less than a point in the last quarter of the training so far."""
    judged = [(h["step"], h["recall@25"]) for h in history if "recall@25" in h]
    if not judged:
        return False
    border = 0.75 * judged[-1][0]
    before = [r for step, r in judged if step <= border]
    last = [r for step, r in judged if step > border]
    return len(before) >= 2 and len(last) >= 2 and max(last) - max(before) < CONVERGED_GAIN
