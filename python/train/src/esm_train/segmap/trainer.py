"""SegMap's training: classification beside reconstruction, checkpoints, resume, recall on held-out sets."""

from __future__ import annotations

import dataclasses
import json
import math
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
from torch.nn import functional
from torch.utils.data import DataLoader

from esm_train.checkpoint import atomically
from esm_train.curves import plot_curves
from esm_train.errors import TrainError
from esm_train.metrics import F32, Sides
from esm_train.segmap.config import SegMapConfig
from esm_train.segmap.data import ClassBatches, Grids, choose_classes, grids_of
from esm_train.segmap.model import BN_MOMENTUM, SegMapNet, Teacher, reconstruction_loss
from esm_train.segmap.weights import write_segmap
from esm_train.validation import judged_part, open_corpus, open_sides, recall_of

FORMAT = "segmap-checkpoint"


class SegMapTrainer:
    """State of one training."""

    def __init__(self, config: SegMapConfig, *, resume: bool) -> None:
        self.config = config
        self.out = Path(config.run.out)
        torch.set_num_threads(config.run.threads)
        torch.manual_seed(config.run.seed)
        t = config.training
        corpus = open_corpus(config.data.train, "data.train")
        known, classes = choose_classes(corpus, t.classes, t.min_observations, config.run.seed)
        self._say(f"{len(classes)} classes of {len(known)} objects")
        self.batches = ClassBatches(corpus, known, classes, config.augment, t.batch, config.run.seed)
        self.model = SegMapNet(t.dropout)
        self.teacher = Teacher(t.classes, t.class_dropout)
        proxies = list(self.teacher.classes.parameters())
        others = [p for n, p in self.teacher.named_parameters() if not n.startswith("classes.")]
        groups = [
            {"params": [*self.model.parameters(), *others], "rate": 1.0},
            {"params": proxies, "rate": t.class_rate},
        ]
        self.optimizer = torch.optim.Adam(groups, lr=t.learning_rate)
        self.step = 0
        self.history: list[dict[str, float]] = []
        self.stopped = False
        if resume:
            self._resume()
        elif self.latest.exists():
            raise TrainError(f"{self.latest} exists already", "continue with --resume, or set another run.out")
        self.validation = self._open_validation()

    @property
    def latest(self) -> Path:
        """The checkpoint that `--resume` reads."""
        return self.out / "latest.pt"

    def _say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def _open_validation(self) -> tuple[Sides, Grids, Grids] | None:
        v = self.config.validation
        if not v.live:
            return None
        sides = judged_part(open_sides(v.map, v.live, "validation"), v.max_live, v.max_map)
        return sides, grids_of(sides.live, sides.live_rows), grids_of(sides.map, sides.map_rows)

    def _resume(self) -> None:
        state = load_state(self.latest)
        now = dataclasses.asdict(self.config)
        for section, free in (("data", ()), ("augment", ()), ("training", ("steps", "learning_rate_end"))):
            before = {k: v for k, v in state["config"][section].items() if k not in free}
            if before != {k: v for k, v in now[section].items() if k not in free}:
                raise TrainError(
                    f"{self.latest}: was trained with another [{section}]",
                    "resume with the configuration it began with",
                )
        self.model.load_state_dict(state["model"])
        self.teacher.load_state_dict(state["teacher"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step = int(state["step"])
        self.history = list(state["history"])

    def run(self) -> bool:
        """Trains to the last step; False when it was stopped by a signal before."""
        config, t = self.config, self.config.training
        workers = config.run.workers
        loader = DataLoader(
            self.batches,
            batch_size=None,
            sampler=range(self.step, t.steps),
            num_workers=workers,
            prefetch_factor=2 if workers else None,
            worker_init_fn=_ignore_interrupts if workers else None,
        )
        previous = {n: signal.signal(n, self._stop) for n in (signal.SIGINT, signal.SIGTERM)}
        clock, counted = time.monotonic(), 0
        try:
            for grids in loader:
                record = self._train_step(grids)
                self.step += 1
                counted += len(grids)
                if self.step % config.run.log_every == 0 or self.step == t.steps:
                    self.history.append(record)
                    rate = counted / (time.monotonic() - clock)
                    text = " ".join(f"{k} {v:.4g}" for k, v in record.items())
                    self._say(f"{text} of {t.steps}, {rate:.0f} segments/s")
                    clock, counted = time.monotonic(), 0
                if self.step % config.validation.every == 0 or self.step == t.steps:
                    self._validate()
                    clock = time.monotonic()
                done = self.stopped or self.step == t.steps
                if done or self.step % config.run.checkpoint_every == 0:
                    self.save()
                if done:
                    break
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
        return self.step >= t.steps

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        self.stopped = True

    def _rate(self) -> float:
        t = self.config.training
        fall = 0.5 * (1.0 + math.cos(math.pi * self.step / max(t.steps - 1, 1)))
        rate = t.learning_rate_end + (t.learning_rate - t.learning_rate_end) * fall
        return rate * min(1.0, (self.step + 1) / (t.warmup_steps + 1))

    def _train_step(self, grids: Grids) -> dict[str, float]:
        # Keyed by the step: drop-out is the same whether or not the training was interrupted.
        torch.manual_seed((self.config.run.seed * 1_000_003 + self.step) % 2**63)
        for group in self.optimizer.param_groups:
            group["lr"] = group["rate"] * self._rate()
        momentum = max(BN_MOMENTUM, 1.0 / (self.step + 1))
        self.model.bn1.momentum = self.model.bn2.momentum = momentum
        self.model.train()
        self.teacher.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.config.run.precision == "bf16"):
            hidden = self.model.encode(grids.cells, grids.extents)
            logits = self.teacher.classify(self.model.bn2(hidden.float()))
            cells = self.teacher.reconstruct(hidden)
        named = functional.cross_entropy(logits.float(), grids.labels)
        rebuilt = reconstruction_loss(cells, grids.cells)
        loss = named + self.config.training.reconstruction_weight * rebuilt
        if not bool(torch.isfinite(loss)):
            raise TrainError(f"step {self.step}: the loss is not finite", "lower training.learning_rate")
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        right = (logits.detach().argmax(dim=1) == grids.labels).float().mean()
        return {
            "step": self.step + 1.0,
            "loss": float(loss.detach()),
            "class": float(named.detach()),
            "reconstruction": float(rebuilt.detach()),
            "accuracy": float(right),
            "learning_rate": self._rate(),
        }

    def _validate(self) -> None:
        if self.validation is None:
            return
        sides, live, mapped = self.validation
        bf16 = self.config.run.precision == "bf16"
        result = recall_of(sides, describe_grids(self.model, live, bf16), describe_grids(self.model, mapped, bf16))
        self.history.append({"step": float(self.step), **result})
        self._say(f"step {self.step} " + " ".join(f"{k} {v:.3f}" for k, v in result.items()))
        plot_curves(self.history, self.out / "curves.png")

    def save(self) -> None:
        """Writes the checkpoint and the history beside it."""
        state = {
            "format": FORMAT,
            "model": self.model.state_dict(),
            "teacher": self.teacher.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
            "history": self.history,
            "config": dataclasses.asdict(self.config),
        }
        atomically(self.latest, lambda part: torch.save(state, part))
        text = json.dumps(self.history, indent=0)
        atomically(self.out / "history.json", lambda part: _write(part, text))


def load_state(file: Path) -> dict[str, Any]:
    """A checkpoint of this training; tensors on the CPU."""
    try:
        state = torch.load(file, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise TrainError(f"{file}: no such checkpoint", "train first, or leave --resume away") from None
    except Exception as error:  # torch.load raises a dozen kinds for damaged files
        raise TrainError(f"{file}: cannot be read: {type(error).__name__}: {error}") from None
    if not isinstance(state, dict) or state.get("format") != FORMAT:
        raise TrainError(f"{file}: no checkpoint of esm-train segmap")
    return state


@torch.no_grad()
def describe_grids(model: SegMapNet, grids: Grids, bf16: bool = False, batch: int = 128) -> F32:
    """Descriptors (B, 64)."""
    was_training = model.training
    model.eval()
    rows: list[F32] = []
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        for start in range(0, len(grids), batch):
            part = slice(start, start + batch)
            rows.append(model(grids.cells[part], grids.extents[part]).float().numpy())
    model.train(was_training)
    return np.concatenate(rows)


def _ignore_interrupts(_worker: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def export(config: SegMapConfig) -> dict[str, Any]:
    """Writes the weights of the last checkpoint; what they are and how they did."""
    state = load_state(Path(config.run.out) / "latest.pt")
    model = SegMapNet().eval()
    model.load_state_dict(state["model"])
    t = state["config"]["training"]
    judged = [h for h in state["history"] if "recall@25" in h]
    facts = {
        "training_data": config.export.training_data,
        "training": f"{state['step']} batches of {t['batch']}, {t['classes']} classes",
    }
    file = Path(config.export.weights or Path(config.run.out) / "segmap.safetensors")
    write_segmap(model, file, facts)
    return {"weights": str(file), "bytes": file.stat().st_size, **facts, "validation": judged}
