"""Segments to network inputs: a training batch with augmentation, or segments as they are for inference."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.data import Dataset

from esm_train.augment import Augmentation, augment
from esm_train.corpus import BatchSampler, Corpus
from esm_train.model import EsmNet
from esm_train.neighbours import neighbour_lists, neighbour_lists_torch
from esm_train.plan import Plan
from esm_train.sampling import normalise, rng_of_points, sample
from esm_train.sizes import measures

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


@dataclass
class Inputs:
    """Network inputs of B segments."""

    points: Tensor
    """(B, 256, 3), normalised."""
    neighbours: list[Tensor]
    """A (B, P, K) int16 list a layer; empty = to be made on the device."""
    measures: Tensor
    """(B, plan.measures) before standardisation."""

    def __len__(self) -> int:
        return self.points.shape[0]

    def part(self, start: int, end: int) -> Inputs:
        """Segments start .. end."""
        return Inputs(self.points[start:end], [n[start:end] for n in self.neighbours], self.measures[start:end])

    def to(self, device: torch.device, plan: Plan) -> Inputs:
        """On the device, neighbours made there where they are missing."""
        points = self.points.to(device, non_blocking=True)
        lists = [n.to(device, non_blocking=True) for n in self.neighbours]
        return Inputs(points, lists or neighbour_lists_torch(points, plan), self.measures.to(device, non_blocking=True))


def make_inputs(samples: list[F32], measured: F32, plan: Plan, lists: bool) -> Inputs:
    """From the 256 sampled points of each segment, and what was measured on all of its points."""
    normalised = [normalise(s, plan.turned) for s in samples]
    neighbours: list[Tensor] = []
    if lists:
        each = [neighbour_lists(p, plan) for p in normalised]
        neighbours = [torch.from_numpy(np.stack(layer).astype(np.int16)) for layer in zip(*each, strict=True)]
    return Inputs(torch.from_numpy(np.stack(normalised)), neighbours, torch.from_numpy(measured))


def inference_inputs(corpus: Corpus, rows: I64, plan: Plan, lists: bool = True) -> Inputs:
    """Segments as they are; the sample of each is keyed by its points."""
    points, offsets = corpus.gather(rows)
    parts = [points[a:b] for a, b in itertools.pairwise(offsets)]
    samples = [sample(p, plan.input_points, rng_of_points(p)) for p in parts]
    measured = measures(points, offsets, corpus.above_ground[rows], corpus.rings[rows], plan)
    return make_inputs(samples, measured, plan, lists)


class TrainingBatches(Dataset[Inputs]):
    """Item `step` is the batch of that step and rank."""

    def __init__(self, sampler: BatchSampler, plan: Plan, how: Augmentation, *, rank: int, lists: bool) -> None:
        self.sampler = sampler
        self.plan = plan
        self.how = how
        self.rank = rank
        self.lists = lists

    def __getitem__(self, step: int) -> Inputs:
        rows = self.sampler.rows(step, self.rank)
        corpus = self.sampler.corpus
        samples: list[F32] = []
        parts: list[F32] = []
        for slot, row in enumerate(rows):
            rng = np.random.default_rng([self.sampler.seed, 2, step, self.rank, slot])
            points = augment(corpus.segment(int(row)), self.how, rng)
            parts.append(points)
            samples.append(sample(points, self.plan.input_points, rng))
        offsets = np.concatenate(([0], np.cumsum([len(p) for p in parts]))).astype(np.int64)
        points, plan = np.concatenate(parts), self.plan
        measured = measures(points, offsets, corpus.above_ground[rows], corpus.rings[rows], plan)
        return make_inputs(samples, measured, plan, self.lists)

    def labels(self) -> Tensor:
        """(classes * per_class,): which rows of any batch are one object."""
        batch = self.sampler.config
        return torch.arange(batch.classes).repeat_interleave(batch.per_class)


@torch.no_grad()
def describe_inputs(model: EsmNet, inputs: Inputs, device: torch.device, batch: int = 128) -> F32:
    """Descriptors (B, descriptor_dim) of prepared segments."""
    was_training = model.training
    model.eval()
    rows: list[F32] = []
    for start in range(0, len(inputs), batch):
        part = inputs.part(start, start + batch).to(device, model.plan)
        rows.append(model(part.points, part.neighbours, part.measures).cpu().numpy())
    model.train(was_training)
    return np.concatenate(rows) if rows else np.zeros((0, model.plan.descriptor_dim), np.float32)


def describe(model: EsmNet, corpus: Corpus, rows: I64, device: torch.device, batch: int = 128) -> F32:
    """Descriptors (len(rows), descriptor_dim), prepared and described piece by piece."""
    lists = device.type == "cpu"
    parts = [
        describe_inputs(model, inference_inputs(corpus, rows[i : i + batch], model.plan, lists), device)
        for i in range(0, len(rows), batch)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, model.plan.descriptor_dim), np.float32)
