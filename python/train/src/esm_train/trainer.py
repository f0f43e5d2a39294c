"""The training loop: one process or several, exact resume, logs, pictures, checkpoints."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from esm_train.checkpoint import atomically, load_checkpoint, save_checkpoint
from esm_train.config import Config
from esm_train.corpus import BatchSampler, Corpus
from esm_train.curves import plot_curves
from esm_train.errors import TrainError
from esm_train.inputs import Inputs, TrainingBatches
from esm_train.losses import Loss, parted_loss
from esm_train.model import DESCRIPTOR_GAIN, EsmNet, parameter_groups
from esm_train.plan import BN_MOMENTUM, Plan
from esm_train.sizes import measures
from esm_train.start import ROWS, start_from
from esm_train.validation import Validation, converged, open_corpus, open_sides


@dataclass(frozen=True)
class Rank:
    """This process among those of torchrun."""

    number: int
    world: int
    local: int

    @property
    def leads(self) -> bool:
        """Whether this process writes."""
        return self.number == 0


@contextlib.contextmanager
def process_group(device: str) -> Iterator[Rank]:
    """The process group of torchrun, where it started this process."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        yield Rank(0, 1, 0)
        return
    on_gpu = device != "cpu" and torch.cuda.is_available()
    dist.init_process_group("nccl" if on_gpu else "gloo")
    try:
        yield Rank(dist.get_rank(), world, int(os.environ.get("LOCAL_RANK", "0")))
    finally:
        dist.destroy_process_group()


def device_of(name: str, rank: int = 0) -> torch.device:
    """The device that a configuration names."""
    if name == "cuda" and not torch.cuda.is_available():
        raise TrainError("run.device = 'cuda': PyTorch finds no CUDA device", "use cpu or auto")
    if name == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    torch.cuda.set_device(rank)
    return torch.device("cuda", rank)


def learning_rate(config: Config, step: int) -> float:
    """Exponential from the first to the last rate, after a linear warm-up."""
    o = config.optim
    rate: float = o.learning_rate * (o.learning_rate_end / o.learning_rate) ** (step / max(o.steps - 1, 1))
    return rate * min(1.0, (step + 1) / (o.warmup_steps + 1))


def measures_statistics(corpus: Corpus, plan: Plan, count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and deviation of sizes and context over at most `count` segments."""
    rows = np.random.default_rng([seed, 3]).permutation(len(corpus))[:count]
    pieces = [
        measures(*corpus.gather(part), corpus.above_ground[part], corpus.rings[part], plan)
        for part in np.array_split(rows, max(1, len(rows) // 1024))
    ]
    table = np.concatenate(pieces).astype(np.float64)
    known = np.asarray(np.isfinite(table).any(axis=0))
    unknown = [f for f, k in zip(plan.size_features, known, strict=False) if not k]
    if unknown:
        raise TrainError(f"size {', '.join(unknown)} is unknown in all training segments", "set above_ground = false")
    std = np.maximum(np.nanstd(table, axis=0), 1e-3)
    return torch.from_numpy(np.nanmean(table, axis=0)).float(), torch.from_numpy(std).float()


class Trainer:
    """State of one training."""

    def __init__(self, config: Config, rank: Rank, *, resume: bool) -> None:
        self.config = config
        self.rank = rank
        self.out = Path(config.run.out)
        if config.run.threads:
            torch.set_num_threads(config.run.threads)
        self.device = device_of(config.run.device, rank.local)
        self.plan = config.plan()
        self.corpus = open_corpus(config.data.train, "data.train")
        torch.manual_seed(config.run.seed)
        self.model = EsmNet(self.plan, config.network.dropout)
        self.step = 0
        self.history: list[dict[str, float]] = []
        state = self._resumed() if resume else None
        if state is None:
            self._initialise()
        self.model.to(self.device)
        self.optimizer = torch.optim.Adam(
            parameter_groups(self.model, config.optim.weight_decay), lr=config.optim.learning_rate
        )
        if state is not None:
            self.optimizer.load_state_dict(state["optimizer"])
        self.stopped = False
        lists = self.device.type == "cpu"
        sampler = BatchSampler(self.corpus, config.batch, config.run.seed)
        self.batches = TrainingBatches(sampler, self.plan, config.augment, rank=rank.number, lists=lists)
        self.validation = self._validation(lists) if rank.leads and config.validation.live else None

    @property
    def latest(self) -> Path:
        """The checkpoint that `--resume` reads."""
        return self.out / "latest.pt"

    def _validation(self, lists: bool) -> Validation:
        v = self.config.validation
        sides = open_sides(v.map, v.live, "validation")
        return Validation(sides, self.plan, max_live=v.max_live, max_map=v.max_map, lists=lists)

    def _initialise(self) -> None:
        if self.latest.exists():
            raise TrainError(f"{self.latest} exists already", "continue with --resume, or set another run.out")
        if self.plan.sizes:
            mean, std = measures_statistics(
                self.corpus, self.plan, self.config.data.size_statistics, self.config.run.seed
            )
            self.model.measures_mean.copy_(mean)
            self.model.measures_std.copy_(std)
        if self.plan.size_mode in ("beside", "both"):
            nn.init.constant_(self.model.size_log_weight, math.log(self.config.network.size_weight))
        with torch.no_grad():
            self.model.fc3_weight.mul_(self.config.network.gain / DESCRIPTOR_GAIN)
        if self.config.network.init_from:
            some = np.random.default_rng([self.config.run.seed, 3]).permutation(len(self.corpus))[:ROWS]
            taken, left = start_from(self.model, Path(self.config.network.init_from), self.corpus, np.sort(some))
            self._say(f"{len(taken)} tensors from {self.config.network.init_from}; anew: {', '.join(left) or 'none'}")

    def _resumed(self) -> dict[str, Any]:
        state = load_checkpoint(self.latest)
        before, now = state["config"], dataclasses.asdict(self.config)
        for section in ("network", "batch", "augment", "loss", "optim", "data"):
            if _plain(before[section]) != _plain(now[section]):
                raise TrainError(
                    f"{self.latest}: was trained with another [{section}]",
                    "resume with the configuration it began with",
                )
        for key in ("seed", "precision"):
            if before["run"][key] != now["run"][key]:
                raise TrainError(
                    f"{self.latest}: was trained with run.{key} = {before['run'][key]}, not {now['run'][key]}",
                    "resume with the configuration it began with",
                )
        self.model.load_state_dict(state["model"])
        self.step = int(state["step"])
        self.history = list(state["history"])
        return state

    def _say(self, text: str) -> None:
        if self.rank.leads:
            tqdm.write(text, file=sys.stderr)

    def run(self, until: int | None = None) -> bool:
        """Trains to the last step, or to `until`; True when the training is complete."""
        config = self.config
        last = config.optim.steps if until is None else min(until, config.optim.steps)
        loader = self._loader(range(self.step, last))
        network: nn.Module = self.model
        if self.rank.world > 1:
            ids = [self.device.index] if self.device.type == "cuda" else None
            network = DistributedDataParallel(self.model, device_ids=ids)
        labels = self.batches.labels().to(self.device)
        writer = SummaryWriter(str(self.out / "tensorboard"), purge_step=self.step) if self.rank.leads else None
        bar = tqdm(
            total=config.optim.steps,
            initial=self.step,
            disable=not (self.rank.leads and sys.stderr.isatty()),
            unit="step",
        )
        previous = self._catch_signals()
        ended = False
        clock, counted = time.monotonic(), 0
        try:
            for inputs in loader:
                loss = self._train_step(network, inputs, labels)
                self.step += 1
                counted += len(inputs)
                bar.update()
                if self.step % config.run.log_every == 0 or self.step == last:
                    rate = counted * self.rank.world / (time.monotonic() - clock)
                    self._log(loss, rate, writer, bar)
                    clock, counted = time.monotonic(), 0
                if self.step % config.validation.every == 0 or self.step == config.optim.steps:
                    ended = self._validate(writer)
                    clock = time.monotonic()
                done = self.step == last or self.stopped or ended
                if self.rank.leads and (done or self.step % config.run.checkpoint_every == 0):
                    self.save()
                if done:
                    break
        finally:
            bar.close()
            if writer is not None:
                writer.close()
            for number, handler in previous.items():
                signal.signal(number, handler)
        return ended or self.step >= config.optim.steps

    def _loader(self, steps: range) -> DataLoader[Inputs]:
        workers = self.config.run.workers
        return DataLoader(
            self.batches,
            batch_size=None,
            sampler=steps,
            num_workers=workers,
            prefetch_factor=2 if workers else None,
            worker_init_fn=_leave_signals_to_the_trainer if workers else None,
        )

    def _train_step(self, network: nn.Module, inputs: Inputs, labels: torch.Tensor) -> Loss:
        config = self.config
        # Keyed by the step: drop-out is the same whether or not the training was interrupted.
        torch.manual_seed(((config.run.seed * 1_000_003 + self.step) * 4096 + self.rank.number) % 2**63)
        for group in self.optimizer.param_groups:
            group["lr"] = group["rate"] * learning_rate(config, self.step)
        network.train()
        self._average_first_batches()
        inputs = inputs.to(self.device, self.plan)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=config.run.precision == "bf16"):
            descriptors = network(inputs.points, inputs.neighbours, inputs.measures)
        loss = parted_loss(descriptors, self.plan.learned_dim, labels, config.loss)
        if not bool(torch.isfinite(loss.total)):
            raise TrainError(f"step {self.step}: the loss is not finite", "lower optim.learning_rate, or set clip_norm")
        self.optimizer.zero_grad(set_to_none=True)
        loss.total.backward()  # type: ignore[no-untyped-call]
        if config.optim.clip_norm > 0.0:
            nn.utils.clip_grad_norm_(self.model.parameters(), config.optim.clip_norm)
        self.optimizer.step()
        return loss

    def _average_first_batches(self) -> None:
        """Running statistics are the plain mean of the first batches, then the paper's exponential one.

        With momentum 0.01 alone they would hold a tenth of their arbitrary first values after 230 steps.
        """
        momentum = max(BN_MOMENTUM, 1.0 / (self.step + 1))
        for module in self.model.modules():
            if isinstance(module, nn.BatchNorm1d):
                module.momentum = momentum

    def _log(self, loss: Loss, rate: float, writer: SummaryWriter | None, bar: tqdm[Any]) -> None:
        if not self.rank.leads:
            return
        record = {
            "step": float(self.step),
            "loss": float(loss.total.detach()),
            "triplet": float(loss.triplet),
            "pair": float(loss.pair),
            "active": float(loss.active),
            "learning_rate": learning_rate(self.config, self.step - 1),
        }
        self.history.append(record)
        bar.set_postfix(loss=f"{record['loss']:.4f}", per_s=f"{rate:.0f}")
        if writer is not None:
            for name, value in {**record, "segments_per_s": rate}.items():
                if name != "step":
                    writer.add_scalar(f"train/{name}", value, self.step)
            if self.plan.size_mode in ("beside", "both"):
                for name, weight in zip(self.plan.size_features, self.model.size_weight(), strict=True):
                    writer.add_scalar(f"size_weight/{name}", float(weight.detach()), self.step)
        if bar.disable:
            self._say(f"step {self.step} loss {record['loss']:.4f} pair {record['pair']:.4f} {rate:.0f} segments/s")

    def _validate(self, writer: SummaryWriter | None) -> bool:
        """True when the training has converged and shall stop then."""
        stop = False
        if self.validation is not None:
            result = self.validation(self.model, self.device)
            self.history.append({"step": float(self.step), **result})
            self._say(f"step {self.step} " + " ".join(f"{k} {v:.3f}" for k, v in result.items()))
            if writer is not None:
                for name, value in result.items():
                    writer.add_scalar(f"validation/{name}", value, self.step)
            plot_curves(self.history, self.out / "curves.png")
            best = max(h["recall@25"] for h in self.history if "recall@25" in h)
            if result["recall@25"] >= best:
                self._save_as(self.out / "best.pt")
            v = self.config.validation
            stop = v.stop_when_converged and self.step >= v.min_steps and converged(self.history)
        if self.rank.world > 1:
            flag = torch.tensor([int(stop)], device=self.device)
            dist.broadcast(flag, src=0)
            stop = bool(flag.item())
        return stop

    def save(self) -> None:
        """Writes the latest checkpoint and the history beside it."""
        self._save_as(self.latest)
        text = json.dumps(self.history, indent=0)
        atomically(self.out / "history.json", lambda part: _write(part, text))

    def _save_as(self, file: Path) -> None:
        save_checkpoint(
            file,
            model=self.model,
            step=self.step,
            history=self.history,
            config=self.config,
            optimizer=self.optimizer,
        )

    def _catch_signals(self) -> dict[int, Any]:
        def stop(_number: int, _frame: FrameType | None) -> None:
            self.stopped = True

        return {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}


def _leave_signals_to_the_trainer(_worker: int) -> None:
    """Ctrl-C reaches the whole group: the workers live on until the trainer has written its checkpoint."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def _plain(value: Any) -> Any:
    """Tuples as lists, as they come back from a checkpoint or not."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value
