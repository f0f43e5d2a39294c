"""The training: it learns, resumes to the bit, and runs on several processes."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.multiprocessing.spawn import start_processes

from esm_train.checkpoint import load_checkpoint
from esm_train.config import Config, NetworkConfig, OptimConfig, ValidationConfig
from esm_train.errors import TrainError
from esm_train.inputs import TrainingBatches, inference_inputs
from esm_train.model import EsmNet
from esm_train.plan import tiny_plan
from esm_train.start import trainable
from esm_train.trainer import Rank, Trainer, learning_rate, process_group
from esm_train.validation import converged, open_corpus
from esm_train.weights import load_network

ALONE = Rank(0, 1, 0)
Make = Callable[..., Config]


def tensors_of(state: object) -> list[torch.Tensor]:
    """All tensors of a nested checkpoint, in order."""
    if isinstance(state, torch.Tensor):
        return [state]
    if isinstance(state, dict):
        return [t for key in state for t in tensors_of(state[key])]
    if isinstance(state, list | tuple):
        return [t for value in state for t in tensors_of(value)]
    return []


@pytest.mark.usefixtures("tiny")
def test_resuming_is_exact(config: Make) -> None:
    whole = Trainer(config(out="whole"), ALONE, resume=False)
    assert whole.run()
    first = Trainer(config(out="parts"), ALONE, resume=False)
    assert not first.run(until=4)
    # Worker processes make the same batches.
    second = Trainer(config(out="parts", workers=1), ALONE, resume=True)
    assert second.step == 4
    assert second.run()
    a, b = load_checkpoint(whole.latest), load_checkpoint(second.latest)
    assert a["step"] == b["step"] == 6
    left, right = ([*tensors_of(s["model"]), *tensors_of(s["optimizer"])] for s in (a, b))
    assert len(left) == len(right) > 100
    assert all(torch.equal(x, y) for x, y in zip(left, right, strict=True))
    assert a["history"] == b["history"]
    assert json.loads((Path(whole.out) / "history.json").read_text()) == a["history"]
    assert (Path(whole.out) / "curves.png").stat().st_size > 1000
    assert list((Path(whole.out) / "tensorboard").iterdir())


@pytest.mark.usefixtures("tiny")
def test_an_interrupt_writes_a_checkpoint(config: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    # Programs in the background may be started with interrupts ignored.
    before = signal.getsignal(signal.SIGINT)
    trainer = Trainer(config(steps=50, workers=1), ALONE, resume=False)
    average = trainer._average_first_batches

    def interrupt() -> None:
        average()
        if trainer.step == 2:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(trainer, "_average_first_batches", interrupt)
    assert not trainer.run()
    assert load_checkpoint(trainer.latest)["step"] == 3
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.usefixtures("tiny")
def test_resuming_with_another_configuration_is_refused(config: Make) -> None:
    Trainer(config(), ALONE, resume=False).run(until=1)
    other = dataclasses.replace(config(), optim=OptimConfig(steps=7))
    with pytest.raises(TrainError, match=r"another \[optim\]"):
        Trainer(other, ALONE, resume=True)
    seeded = dataclasses.replace(config(), run=dataclasses.replace(config().run, seed=9))
    with pytest.raises(TrainError, match=r"run\.seed = 0, not 9"):
        Trainer(seeded, ALONE, resume=True)
    with pytest.raises(TrainError, match="exists already"):
        Trainer(config(), ALONE, resume=False)
    with pytest.raises(TrainError, match="no such checkpoint"):
        Trainer(config(out="nowhere"), ALONE, resume=True)


def test_it_learns(config: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """One batch by heart, without the sizes: the negatives end up farther than the positives."""
    monkeypatch.setattr(Config, "plan", lambda _self: tiny_plan("none"))
    c = config(steps=60)
    c = dataclasses.replace(c, network=NetworkConfig(dropout=0.0), validation=ValidationConfig())
    trainer = Trainer(c, ALONE, resume=False)
    batch = trainer.batches[0]
    monkeypatch.setattr(TrainingBatches, "__getitem__", lambda _self, _step: batch)
    trainer.run()
    first, last = trainer.history[0], trainer.history[-1]
    assert first["active"] > 0.2 and first["triplet"] > 0.1
    assert last["active"] < 0.05 and last["triplet"] < 0.01


@pytest.mark.usefixtures("tiny")
def test_weights_of_one_variant_start_another(config: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    first = Trainer(config(out="first"), ALONE, resume=False)
    first.run(until=2)
    full = dataclasses.replace(tiny_plan("both"), points=(32, 32, 32, 32))
    monkeypatch.setattr(Config, "plan", lambda _self: full)
    c = config(out="second")
    c = dataclasses.replace(c, network=dataclasses.replace(c.network, init_from=str(first.latest)))
    second = Trainer(c, ALONE, resume=False)
    assert torch.equal(second.model.fc3_weight, first.model.fc3_weight)
    assert second.model.plan.points == (32, 32, 32, 32)
    assert float(second.model.fc1_size_weight.detach().abs().max()) == 0.0


def test_a_weights_file_starts_a_training(sets: dict[str, str]) -> None:
    """Its network answers as before, and the batch norms see in training what they are normalised for."""
    weights = Path(__file__).parents[3] / "weights" / "esm-paper.safetensors"
    corpus = open_corpus((sets["train"],), "test")
    rows = np.arange(0, len(corpus), 2)
    before, _, _ = load_network(weights)
    after = EsmNet(before.plan)
    after.load_state_dict(trainable(weights, corpus, rows))
    inputs = inference_inputs(corpus, rows, before.plan)
    want = before(inputs.points, inputs.neighbours, inputs.measures)
    torch.testing.assert_close(
        after.eval()(inputs.points, inputs.neighbours, inputs.measures), want, atol=1e-4, rtol=1e-4
    )
    after.dropout.p = 0.0
    after.train()
    seen = after(inputs.points, inputs.neighbours, inputs.measures)
    torch.testing.assert_close(seen, want, atol=1e-3, rtol=1e-3)


@pytest.mark.usefixtures("tiny")
def test_bf16_trains(config: Make) -> None:
    c = config(steps=3)
    c = dataclasses.replace(c, run=dataclasses.replace(c.run, precision="bf16"))
    trainer = Trainer(c, ALONE, resume=False)
    assert trainer.run()
    assert all(torch.isfinite(p).all() for p in trainer.model.parameters())


@pytest.mark.usefixtures("tiny")
def test_running_statistics_forget_their_first_values(config: Make) -> None:
    trainer = Trainer(config(steps=3), ALONE, resume=False)
    with torch.no_grad():
        for buffer in trainer.model.buffers():
            if buffer.dtype == torch.float32 and buffer.dim() == 1 and len(buffer) > 6:
                buffer.fill_(1e6)
    trainer.run()
    norm = trainer.model.fc1.bn
    assert norm.running_mean is not None and norm.running_var is not None
    assert float(norm.running_mean.abs().max()) < 100.0 and float(norm.running_var.max()) < 100.0


def test_learning_rate_falls_from_first_to_last() -> None:
    c = Config(optim=OptimConfig(steps=100))
    rates = [learning_rate(c, s) for s in range(100)]
    assert rates[0] == pytest.approx(1e-3) and rates[-1] == pytest.approx(1e-6)
    assert all(a > b for a, b in itertools.pairwise(rates))


def test_converged_looks_at_the_last_quarter() -> None:
    def history(values: list[float]) -> list[dict[str, float]]:
        return [{"step": 100.0 * (i + 1), "recall@25": v} for i, v in enumerate(values)]

    assert not converged([])
    assert not converged(history([0.1, 0.5]))
    assert converged(history([0.1, 0.5, 0.6, 0.7, 0.72, 0.72, 0.725, 0.721]))
    assert not converged(history([0.1, 0.5, 0.6, 0.7, 0.72, 0.72, 0.735, 0.721]))


def _worker(rank: int, config: Config, port: int, out: str) -> None:
    os.environ.update(RANK=str(rank), LOCAL_RANK=str(rank), WORLD_SIZE="2", MASTER_ADDR="127.0.0.1")
    os.environ["MASTER_PORT"] = str(port)
    setattr(Config, "plan", lambda _self: tiny_plan())  # noqa: B010
    with process_group("cpu") as place:
        trainer = Trainer(config, place, resume=False)
        trainer.run()
        torch.save([p.detach() for p in trainer.model.parameters()], f"{out}/{rank}.pt")


def test_two_processes_stay_together(config: Make, tmp_path: Path) -> None:
    port = 20_000 + os.getpid() % 20_000
    context = start_processes(  # type: ignore[no-untyped-call]
        _worker, (config(steps=3), port, str(tmp_path)), nprocs=2, start_method="fork"
    )
    assert context is None
    a, b = (torch.load(tmp_path / f"{rank}.pt", weights_only=True) for rank in range(2))
    assert len(a) > 50 and all(torch.equal(x, y) for x, y in zip(a, b, strict=True))
    assert load_checkpoint(tmp_path / "run" / "latest.pt")["step"] == 3
