"""Pictures of the training."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from esm_train.checkpoint import atomically


def plot_curves(history: list[dict[str, float]], file: Path) -> None:
    """Loss, its parts, and the recall on the validation sets, over the steps."""
    train = [h for h in history if "loss" in h]
    judged = [h for h in history if "recall@25" in h]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), constrained_layout=True)
    steps = np.array([h["step"] for h in train])
    parts = (
        ("triplet", "tab:blue"),
        ("pair", "tab:orange"),
        ("active", "tab:green"),
        ("class", "tab:blue"),
        ("accuracy", "tab:green"),
    )
    for name, colour in (("loss", "black"), *parts):
        if not train or name not in train[0]:
            continue
        values = np.array([h[name] for h in train])
        left.plot(steps, values, color=colour, alpha=0.25, linewidth=0.8)
        width = max(1, len(values) // 50)
        if len(values) >= width:
            smooth = np.convolve(values, np.ones(width) / width, mode="valid")
            label = "share of triplets above 0" if name == "active" else name
            left.plot(steps[width - 1 :], smooth, color=colour, label=label)
    left.set(xlabel="step", title="training", ylim=(0, None))
    left.legend()
    for name, colour in (("recall@1", "tab:blue"), ("recall@25", "tab:red")):
        right.plot([h["step"] for h in judged], [h[name] for h in judged], "o-", color=colour, markersize=3, label=name)
    right.set(xlabel="step", title="held-out recall of the true counterpart", ylim=(0, 1))
    right.grid(alpha=0.3)
    if judged:
        right.legend()
    atomically(file, lambda part: figure.savefig(part, format="png", dpi=120))
    plt.close(figure)
