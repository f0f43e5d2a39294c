"""The losses against loops over the triplets."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from esm_train.config import LossConfig
from esm_train.losses import descriptor_loss, parted_loss


def by_loops(d: np.ndarray, labels: list[int], margin: float) -> tuple[list[float], list[float], list[float]]:
    """Costs of all triplets, largest cost of each pair, distances of the pairs."""
    costs, hardest, pairs = [], [], []
    for a in range(len(d)):
        for p in range(len(d)):
            if a == p or labels[a] != labels[p]:
                continue
            ap = float(((d[a] - d[p]) ** 2).sum())
            own = [
                max(0.0, 1.0 - float(((d[a] - d[n]) ** 2).sum()) / (ap + margin))
                for n in range(len(d))
                if labels[n] != labels[a]
            ]
            costs += own
            hardest.append(max(own))
            pairs.append(ap)
    return costs, hardest, pairs


@pytest.mark.parametrize("mining", ["all", "active", "hard"])
def test_by_loops(mining: str) -> None:
    d = np.random.default_rng(0).normal(size=(8, 4))
    labels = [0, 0, 1, 1, 2, 2, 2, 3]
    costs, hardest, pairs = by_loops(d, labels, 0.01)
    above = [c for c in costs if c > 0]
    assert 0 < len(above) < len(costs)
    triplet = {"all": np.mean(costs), "active": np.mean(above), "hard": np.mean(hardest)}[mining]
    loss = descriptor_loss(torch.from_numpy(d), torch.tensor(labels), LossConfig(mining=mining, pair_weight=0.3))
    assert float(loss.total) == pytest.approx(triplet + 0.3 * np.mean(pairs), rel=1e-5)
    assert float(loss.active) == pytest.approx(len(above) / len(costs))


@pytest.mark.parametrize("kind", ["softmax", "power"])
def test_softmax_by_loops(kind: str) -> None:
    d = np.random.default_rng(1).normal(size=(6, 3))
    labels = [0, 0, 1, 1, 2, 2]
    config = LossConfig(kind=kind, temperature=0.7, power=2.5, margin=0.4, pair_weight=0.0)
    terms = []

    def weight(squared: float) -> float:
        return float(np.exp(-squared / 0.7) if kind == "softmax" else (squared + 0.4) ** -2.5)

    for a in range(6):
        for p in range(6):
            if a != p and labels[a] == labels[p]:
                e = {n: weight(((d[a] - d[n]) ** 2).sum()) for n in range(6) if n == p or labels[n] != labels[a]}
                terms.append(-np.log(e[p] / sum(e.values())))
    loss = descriptor_loss(torch.from_numpy(d), torch.tensor(labels), config)
    assert float(loss.total) == pytest.approx(np.mean(terms), rel=1e-5)


def test_collapse_has_cost_one_and_no_gradient() -> None:
    """The trap of the reference: when all descriptors coincide nothing pulls them apart."""
    d = torch.zeros(4, 3, requires_grad=True)
    loss = descriptor_loss(d, torch.tensor([0, 0, 1, 1]), LossConfig())
    loss.total.backward()  # type: ignore[no-untyped-call]
    assert float(loss.total.detach()) == 1.0
    assert d.grad is not None and float(d.grad.abs().max()) == 0.0


def test_the_learned_numbers_bear_their_share() -> None:
    d = torch.from_numpy(np.random.default_rng(2).normal(size=(6, 5)))
    labels = torch.tensor([0, 0, 1, 1, 2, 2])
    whole, learned = (float(descriptor_loss(x, labels, LossConfig()).total) for x in (d, d[:, :3]))
    shared = parted_loss(d, 3, labels, LossConfig(learned_share=0.25))
    assert float(shared.total) == pytest.approx(0.75 * whole + 0.25 * learned)
    assert float(parted_loss(d, 5, labels, LossConfig(learned_share=0.25)).total) == pytest.approx(whole)
