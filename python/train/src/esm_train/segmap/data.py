"""Objects as classes, batches of their views, and segments as the network sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.data import Dataset

from esm_train.augment import Augmentation, augment
from esm_train.corpus import Corpus, Identities, identities
from esm_train.errors import TrainError
from esm_train.segmap.grid import occupancy

I64 = npt.NDArray[np.int64]


@dataclass
class Grids:
    """What enters the network of B segments."""

    cells: Tensor
    """(B, 32, 32, 16) bytes, 1 = occupied."""
    extents: Tensor
    """(B, 3) in metres."""
    labels: Tensor
    """(B,) classes; empty where there are none."""

    def __len__(self) -> int:
        return self.cells.shape[0]


def grids_of(corpus: Corpus, rows: I64) -> Grids:
    """Segments as they are."""
    both = [occupancy(corpus.segment(int(row))) for row in rows]
    cells, extents = (np.stack(part) for part in zip(*both, strict=True))
    return Grids(torch.from_numpy(cells), torch.from_numpy(extents), torch.zeros(0, dtype=torch.long))


def choose_classes(corpus: Corpus, count: int, min_observations: int, seed: int) -> tuple[Identities, I64]:
    """The objects of the corpus, and which `count` of them are the classes.

    Kinds of places (the first word of a place's name) take turns, so that a kind of many worlds does not crowd out
    one of few; within a kind the choice is random.
    """
    known = identities(corpus)
    first = known.rows[known.starts[:-1]]
    enough = np.flatnonzero(np.diff(known.starts) >= min_observations)
    if len(enough) < count:
        raise TrainError(
            f"{len(enough)} objects were seen {min_observations} times or more, training.classes is {count}",
            "give more data, or lower training.classes or training.min_observations",
        )
    names = [name.partition(":")[0] for name in corpus.places]
    kind = np.array([sorted(set(names)).index(n) for n in names])[corpus.place[first[enough]]]
    order = np.random.default_rng([seed, 11]).permutation(len(enough))
    turn = np.empty(len(enough), np.int64)
    for k in np.unique(kind):
        members = order[kind[order] == k]
        turn[members] = np.arange(len(members))
    chosen = np.lexsort((kind, turn))[:count]
    return known, np.sort(enough[chosen])


class ClassBatches(Dataset[Grids]):
    """Item `step` is the batch of that step: random views of random classes."""

    def __init__(
        self, corpus: Corpus, known: Identities, classes: I64, how: Augmentation, batch: int, seed: int
    ) -> None:
        self.corpus = corpus
        self.known = known
        self.classes = classes
        self.how = how
        self.batch = batch
        self.seed = seed

    def __getitem__(self, step: int) -> Grids:
        rng = np.random.default_rng([self.seed, 12, step])
        # Each class once a round, in an order of the round's own.
        at = np.arange(step * self.batch, (step + 1) * self.batch)
        labels = np.array([self._order(int(i) // len(self.classes))[int(i) % len(self.classes)] for i in at])
        both = []
        for label in labels:
            rows = self.known.of(int(self.classes[label]))
            points = self.corpus.segment(int(rows[rng.integers(len(rows))]))
            both.append(occupancy(augment(points, self.how, rng)))
        cells, extents = (np.stack(part) for part in zip(*both, strict=True))
        return Grids(torch.from_numpy(cells), torch.from_numpy(extents), torch.from_numpy(labels))

    def _order(self, around: int) -> I64:
        order: I64 = np.random.default_rng([self.seed, 13, around]).permutation(len(self.classes))
        return order
