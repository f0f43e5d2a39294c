"""Pictures of an evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from esm_train.checkpoint import atomically
from esm_train.corpus import Corpus
from esm_train.metrics import F32, I64, Roc

if TYPE_CHECKING:
    from esm_train.evaluate import Judgement


def _save(figure: Any, file: Path) -> None:
    atomically(file, lambda part: figure.savefig(part, format="png", dpi=120))
    plt.close(figure)


def plot_roc(judgements: list[Judgement], file: Path) -> None:
    """ROC curves with random and with hard negatives; dashed without the worst third by quality."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 5), constrained_layout=True)

    def draw(axis: Any, curve: Roc | None, label: str, **style: Any) -> None:
        if curve is not None:
            axis.plot(curve.false_positive, curve.true_positive, label=f"{label} ({curve.auc:.3f})", **style)

    for number, j in enumerate(judgements):
        colour = f"C{number}"
        draw(axes[0], j.random, j.name, color=colour)
        draw(axes[0], j.best_random, f"{j.name}, best two thirds", color=colour, linestyle="--")
        draw(axes[1], j.hard, j.name, color=colour)
        draw(axes[1], j.best_hard, f"{j.name}, best two thirds", color=colour, linestyle="--")
    for axis, title in zip(axes, ("random negatives", "hard negatives: alike in size"), strict=True):
        axis.plot([0, 1], [0, 1], color="grey", linewidth=0.5)
        axis.set(xlabel="false positive rate", ylabel="true positive rate", title=title)
        axis.legend(fontsize=8, loc="lower right")
    _save(figure, file)


def plot_recall(judgements: list[Judgement], file: Path) -> None:
    """Bars of recall at 1, 25 and 100."""
    figure, axis = plt.subplots(figsize=(7, 4), constrained_layout=True)
    ks = list(judgements[0].recall)
    width = 0.8 / len(judgements)
    for number, j in enumerate(judgements):
        bars = axis.bar(np.arange(len(ks)) + number * width, [j.recall[k] for k in ks], width, label=j.name)
        axis.bar_label(bars, fmt="%.2f", fontsize=7)
    axis.set_xticks(np.arange(len(ks)) + 0.4 - width / 2, [f"recall@{k}" for k in ks])
    axis.set(ylim=(0, 1.05), title="true counterpart among the k nearest of the whole map")
    axis.legend(fontsize=8, loc="upper left")
    _save(figure, file)


def plot_reliability(judgements: list[Judgement], file: Path) -> None:
    """Predicted quality against the share that was matched rightly."""
    figure, axis = plt.subplots(figsize=(5, 5), constrained_layout=True)
    axis.plot([0, 1], [0, 1], color="grey", linewidth=0.5)
    for j in judgements:
        if j.calibration is not None:
            c = j.calibration
            axis.plot(c.predicted, c.observed, "o-", label=f"{j.name} (error {c.error:.3f})")
    axis.set(xlabel="predicted quality", ylabel="nearest in the map is right", xlim=(0, 1), ylim=(0, 1))
    if axis.get_legend_handles_labels()[0]:
        axis.legend()
    _save(figure, file)


def plot_embedding(descriptors: F32, corpus: Corpus, rows: I64, title: str, file: Path) -> None:
    """The first two principal components: by class, and of the twelve objects seen most often."""
    centred = descriptors - descriptors.mean(axis=0)
    _, strength, axes = np.linalg.svd(centred, full_matrices=False)
    xy = centred @ axes[:2].T
    share = strength[:2] ** 2 / (strength**2).sum()
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5.5), constrained_layout=True)
    labels = corpus.label[rows]
    for label in np.unique(labels):
        chosen = labels == label
        name = corpus.classes[label] if label >= 0 else "unknown"
        left.scatter(*xy[chosen].T, s=3, alpha=0.5, label=name, color=f"C{label}" if label >= 0 else "lightgrey")
    left.legend(markerscale=4, fontsize=8)
    right.scatter(*xy.T, s=2, color="lightgrey")
    known = np.flatnonzero(corpus.object[rows] >= 0)
    keys = np.stack((corpus.place[rows][known], corpus.object[rows][known]), axis=1)
    things, member, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    for number, thing in enumerate(np.argsort(-count, kind="stable")[:12]):
        chosen = known[member.reshape(-1) == thing]
        colour = plt.get_cmap("tab20")(number)
        right.scatter(*xy[chosen].T, s=14, color=[colour], label=f"object {things[thing][1]}")
    if len(things):
        right.legend(fontsize=7)
    for axis, what in ((left, "by class"), (right, "objects seen most often")):
        axis.set(
            xlabel=f"component 1 ({share[0]:.0%})", ylabel=f"component 2 ({share[1]:.0%})", title=f"{title}, {what}"
        )
    _save(figure, file)
