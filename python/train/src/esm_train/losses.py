"""The losses of the paper (section 3 of the method), on squared L2 distances of descriptors."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from esm_train.config import LossConfig


@dataclass(frozen=True)
class Loss:
    """The loss and what is logged of it."""

    total: Tensor
    triplet: Tensor
    pair: Tensor
    active: Tensor
    """Share of triplets whose negative is nearer than the positive plus the margin."""


BY_DIFFERENCES = 512
"""Larger batches take the memory of a matrix product instead of that of all differences."""


def squared_distances(descriptors: Tensor) -> Tensor:
    """(B, B); of small batches by differences, which do not cancel for near descriptors."""
    if len(descriptors) > BY_DIFFERENCES:
        squares = (descriptors * descriptors).sum(dim=1)
        return (squares[:, None] + squares[None, :] - 2.0 * descriptors @ descriptors.T).clamp(min=0.0)
    d = descriptors[:, None, :] - descriptors[None, :, :]
    return (d * d).sum(dim=2)


def descriptor_loss(descriptors: Tensor, labels: Tensor, config: LossConfig) -> Loss:
    """Descriptors (B, D) and labels (B,) -> mean over triplets plus weighted mean over pairs.

    The paper's triplet cost is c = max(0, 1 - D(a, n) / (D(a, p) + margin)). It is silent about which triplets of a
    batch count: `mining` chooses all valid ones, those above zero, or the nearest negative of each pair.
    """
    distance = squared_distances(descriptors.float())
    same = labels[:, None] == labels[None, :]
    anchor, positive = torch.nonzero(same & ~torch.eye(len(labels), dtype=torch.bool, device=labels.device)).T
    to_positive = distance[anchor, positive]
    to_others = distance[anchor]
    others = ~same[anchor]
    cost = torch.relu(1.0 - to_others / (to_positive[:, None] + config.margin))
    above = (cost > 0.0) & others
    active = above.sum() / others.sum()
    pair = to_positive.mean()
    if config.kind != "triplet":
        against = torch.where(others, likeness(to_others, config), float("-inf"))
        own = likeness(to_positive, config)
        logits = torch.cat((own[:, None], against), dim=1)
        triplet = (torch.logsumexp(logits, dim=1) - own).mean()
    elif config.mining == "hard":
        triplet = torch.where(others, cost, 0.0).max(dim=1).values.mean()
    else:
        total = torch.where(others, cost, 0.0).sum()
        count = above.sum() if config.mining == "active" else others.sum()
        triplet = total / count.clamp(min=1)
    return Loss(triplet + config.pair_weight * pair, triplet.detach(), pair.detach(), active.detach())


def likeness(squared: Tensor, config: LossConfig) -> Tensor:
    """Logits of squared distances: a Gaussian's, or a power law's, whose tails forgive pairs that cannot be told."""
    if config.kind == "softmax":
        return -squared / config.temperature
    return -config.power * torch.log(squared + config.margin)


def parted_loss(descriptors: Tensor, learned_dim: int, labels: Tensor, config: LossConfig) -> Loss:
    """The loss of the whole descriptor, and by `learned_share` that of its first `learned_dim` numbers alone."""
    whole = descriptor_loss(descriptors, labels, config)
    share = config.learned_share
    if share == 0.0 or learned_dim == descriptors.shape[1]:
        return whole
    learned = descriptor_loss(descriptors[:, :learned_dim], labels, config)
    return Loss((1.0 - share) * whole.total + share * learned.total, whole.triplet, whole.pair, whole.active)
