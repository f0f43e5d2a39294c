"""Evaluation: recall in the whole map, ROC with random and hard negatives, calibration of the quality, pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esm_train.checkpoint import atomically
from esm_train.corpus import Corpus
from esm_train.describers import Describer
from esm_train.errors import TrainError
from esm_train.metrics import (
    F32,
    F64,
    I64,
    Pairs,
    Reliability,
    Roc,
    Sides,
    hard_negatives,
    nearest_in_map,
    pair_scores,
    positive_pairs,
    random_negatives,
    recall_at,
    reliability,
    roc,
)
from esm_train.plots import plot_embedding, plot_recall, plot_reliability, plot_roc
from esm_train.sizes import LENGTH_FLOOR_M, eigen_features

KS = (1, 25, 100)


@dataclass
class Judgement:
    """How one descriptor did."""

    name: str
    recall: dict[int, float]
    random: Roc
    hard: Roc
    best_random: Roc | None = None
    """Without the worst third of the pairs by quality."""
    best_hard: Roc | None = None
    calibration: Reliability | None = None


def baseline_descriptors(corpus: Corpus, rows: I64) -> dict[str, F32]:
    """eigen (7), sizes (6) and shape (both), not yet standardised."""
    eigen = np.concatenate([eigen_features(*corpus.gather(rows[i : i + 1024])) for i in range(0, len(rows), 1024)])
    sizes = np.log(corpus.lengths(rows) + LENGTH_FLOOR_M).astype(np.float32)
    return {"eigen": eigen, "sizes": sizes, "shape": np.concatenate((eigen, sizes), axis=1)}


def standardised(live: F32, mapped: F32) -> tuple[F32, F32]:
    """By mean and deviation over the map."""
    mean, std = mapped.mean(axis=0), np.maximum(mapped.std(axis=0), 1e-9)
    return (live - mean) / std, (mapped - mean) / std


class Evaluation:
    """A map and live segments, with the pairs on which every descriptor is judged."""

    def __init__(self, sides: Sides, seed: int = 0) -> None:
        self.sides = sides
        self.judged = sides.judged()
        if not len(self.judged):
            raise TrainError(
                "no live segment has a counterpart in the map",
                "do both sets name the same places? --truth position compares centroids",
            )
        self.live_lengths = sides.live.lengths(sides.live_rows)
        self.map_lengths = sides.map.lengths(sides.map_rows)
        self.positive = positive_pairs(sides, self.judged, seed)
        self.random = random_negatives(sides, self.judged, seed)
        self.hard = hard_negatives(sides, self.judged, self.live_lengths, self.map_lengths, seed)

    def judge(self, name: str, live: F32, mapped: F32, quality: tuple[F64, F64] | None = None) -> Judgement:
        """Descriptors of all live and all map segments, and where there is one their quality."""
        s = self.sides
        rows = self.judged
        index, _ = nearest_in_map(live[rows], mapped, s.live_place[rows], s.map_place, max(KS))
        scores = {k: pair_scores(live, mapped, p) for k, p in self._pairs().items()}
        result = Judgement(
            name,
            recall_at(s, rows, index, KS),
            roc(scores["positive"], scores["random"]),
            roc(scores["positive"], scores["hard"]),
        )
        if quality is not None:
            joint = {k: quality[0][p.live] * quality[1][p.map] for k, p in self._pairs().items()}
            result.best_random = _without_worst_third(scores, joint, "random")
            result.best_hard = _without_worst_third(scores, joint, "hard")
            right = (index[:, 0] >= 0) & s.same(rows, np.maximum(index[:, 0], 0))
            result.calibration = reliability(quality[0][rows], right)
        return result

    def _pairs(self) -> dict[str, Pairs]:
        return {"positive": self.positive, "random": self.random, "hard": self.hard}


def _without_worst_third(scores: dict[str, F64], joint: dict[str, F64], negatives: str) -> Roc:
    """Of positives and negatives together, the third of lowest joint quality is dropped."""
    both = np.concatenate((joint["positive"], joint[negatives]))
    least = np.quantile(both, 1.0 / 3.0)
    return roc(scores["positive"][joint["positive"] >= least], scores[negatives][joint[negatives] >= least])


def evaluate(describers: Sequence[Describer], sides: Sides, out: Path, seed: int = 0) -> dict[str, Any]:
    """Judges them and the baselines; writes `report.json` and the pictures into `out`."""
    evaluation = Evaluation(sides, seed)
    judgements: list[Judgement] = []
    live_base = baseline_descriptors(sides.live, sides.live_rows)
    map_base = baseline_descriptors(sides.map, sides.map_rows)
    for name in live_base:
        judgements.append(evaluation.judge(name, *standardised(live_base[name], map_base[name])))
    out.mkdir(parents=True, exist_ok=True)
    for describer in describers:
        live, live_quality = describer(sides.live, sides.live_rows)
        mapped, map_quality = describer(sides.map, sides.map_rows)
        name = describer.name
        both = None if live_quality is None or map_quality is None else (live_quality, map_quality)
        judgements.append(evaluation.judge(name, live, mapped, both))
        plot_embedding(mapped, sides.map, sides.map_rows, f"{name}: map segments", out / f"embedding-{name}.png")
    plot_roc(judgements, out / "roc.png")
    plot_recall(judgements, out / "recall.png")
    plot_reliability(judgements, out / "reliability.png")
    report = {
        "map_segments": len(sides.map_rows),
        "live_segments": len(sides.live_rows),
        "judged": len(evaluation.judged),
        "hard_negatives": len(evaluation.hard.live),
        "random_negatives": len(evaluation.random.live),
        "truth": sides.truth,
        "radius_m": sides.radius_m,
        "descriptors": {j.name: _as_dict(j) for j in judgements},
    }
    text = json.dumps(report, indent=1)
    atomically(out / "report.json", lambda part: _write(part, text))
    return report


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def _as_dict(j: Judgement) -> dict[str, Any]:
    out: dict[str, Any] = {f"recall@{k}": round(v, 4) for k, v in j.recall.items()}
    out |= {"auc_random": round(j.random.auc, 4), "auc_hard": round(j.hard.auc, 4)}
    if j.best_random is not None and j.best_hard is not None and j.calibration is not None:
        out |= {
            "auc_random_best_two_thirds": round(j.best_random.auc, 4),
            "auc_hard_best_two_thirds": round(j.best_hard.auc, 4),
            "calibration_error": round(j.calibration.error, 4),
            "reliability": {
                "predicted": [round(float(v), 4) for v in j.calibration.predicted],
                "observed": [round(float(v), 4) for v in j.calibration.observed],
                "count": [int(v) for v in j.calibration.count],
            },
        }
    return out


def table(report: dict[str, Any]) -> str:
    """The report as a table in Markdown."""
    lines = [
        f"{report['judged']} of {report['live_segments']} live segments have a counterpart among "
        f"{report['map_segments']} map segments; {report['hard_negatives']} hard negatives",
        "",
        "| descriptor | recall@1 | recall@25 | recall@100 | AUC | AUC, hard | AUC, hard, best two thirds |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, j in report["descriptors"].items():
        best = j.get("auc_hard_best_two_thirds")
        cells = [j["recall@1"], j["recall@25"], j["recall@100"], j["auc_random"], j["auc_hard"]]
        lines.append(
            f"| {name} | " + " | ".join(f"{c:.3f}" for c in cells) + f" | {'' if best is None else f'{best:.3f}'} |"
        )
    return "\n".join(lines)
