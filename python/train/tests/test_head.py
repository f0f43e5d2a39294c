"""The last layers, trained on frozen ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from esm_train.checkpoint import load_checkpoint
from esm_train.config import Config, HeadConfig
from esm_train.corpus import BatchSampler, Corpus, identities
from esm_train.errors import TrainError
from esm_train.head import rows_to_hold, shapes
from esm_train.inputs import describe
from esm_train.model import EsmNet
from esm_train.plan import tiny_plan
from esm_train.run import head, train
from esm_train.segments import SegmentSet

Make = Callable[..., Config]


@pytest.fixture
def joined(config: Make, monkeypatch: pytest.MonkeyPatch) -> Config:
    """A few steps of the tiny network with context."""
    monkeypatch.setattr(Config, "plan", lambda _self: tiny_plan("beside", context=True))
    return dataclasses.replace(config(), head=HeadConfig(steps=150, classes=40, places=0))


def test_the_last_layers_learn_and_the_others_stay(joined: Config) -> None:
    assert train(joined, resume=False)
    head(joined)
    out = Path(joined.run.out)
    before, after = (load_checkpoint(out / name) for name in ("latest.pt", "head.pt"))
    changed = {n for n, t in before["model"].items() if not torch.equal(t, after["model"][n])}
    assert {"join.weight", "fc3_weight", "fc3_bias", "size_log_weight"} <= changed
    assert all(n.startswith(("join.", "fc3", "size_log_weight")) for n in changed)
    losses = [h["loss"] for h in after["history"]]
    assert losses[-1] < losses[0]
    assert after["history"][-1]["recall@1"] > 0.5
    (kept,) = out.glob("shapes-*.npz")
    written = kept.stat().st_mtime_ns
    head(joined)
    assert kept.stat().st_mtime_ns == written, "the same network on the same rows is not run again"
    again = load_checkpoint(out / "head.pt")["model"]
    assert all(torch.equal(t, again[n]) for n, t in after["model"].items())


def test_frozen_numbers_and_last_layers_are_the_network(sets: dict[str, str]) -> None:
    torch.manual_seed(0)
    model = EsmNet(tiny_plan("both", context=True)).eval()
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    rows = np.arange(0, 150, 7)
    device = torch.device("cpu")
    pooled, measured = shapes(model, corpus, rows, device, workers=0, bf16=False)
    with torch.no_grad():
        put_together = model.descriptor(torch.from_numpy(pooled), torch.from_numpy(measured)).numpy()
    np.testing.assert_allclose(put_together, describe(model, corpus, rows, device), atol=1e-5)


def test_whole_objects_are_held(sets: dict[str, str], config: Make) -> None:
    corpus = Corpus([SegmentSet(Path(sets["train"]))])
    sampler = BatchSampler(corpus, config().batch, 0)
    rows = rows_to_hold(sampler, 50, 0)
    assert len(rows) == 48, "sixteen objects of three views"
    held = identities(corpus, rows)
    assert len(held) == 16 and (np.diff(held.starts) == 3).all()
    with pytest.raises(TrainError, match="most_segments"):
        rows_to_hold(sampler, 2, 0)


def test_networks_without_context_have_no_such_layers(config: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Config, "plan", lambda _self: tiny_plan())
    asked = dataclasses.replace(config(), head=HeadConfig(steps=1))
    assert train(asked, resume=False)
    with pytest.raises(TrainError, match=r"set head\.steps = 0"):
        head(asked)
