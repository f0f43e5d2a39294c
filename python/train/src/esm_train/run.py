"""What the commands do: training, quality head and export, evaluation, one after the other."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from esm_train import balance
from esm_train.checkpoint import load_checkpoint, model_of, save_checkpoint
from esm_train.config import Config
from esm_train.describers import PyTorch
from esm_train.evaluate import evaluate, table
from esm_train.head import train_head
from esm_train.inputs import describe
from esm_train.metrics import Sides
from esm_train.model import EsmNet, QualityHead
from esm_train.plan import Plan
from esm_train.quality import distance_thresholds, nearest_is_right, train_quality
from esm_train.trainer import Trainer, device_of, process_group
from esm_train.validation import Validation, converged, open_corpus, open_sides
from esm_train.weights import load_network, to_weights, write_weights


def train(config: Config, resume: bool) -> bool:
    """Trains; True when it came to its end, False when it was interrupted."""
    with process_group(config.run.device) as rank:
        trainer = Trainer(config, rank, resume=resume)
        done = trainer.run()
        if rank.leads:
            word = "converged" if converged(trainer.history) else "not converged by the last quarter's recall@25"
            how = f"complete, {word}" if done else "stopped; continue with --resume"
            print(f"step {trainer.step}: {how}", file=sys.stderr)
    return done


def head(config: Config, checkpoint: Path | None = None) -> None:
    """Trains the last layers further on the frozen ones; writes `head.pt`."""
    device = device_of(config.run.device)
    state = load_checkpoint(checkpoint or Path(config.run.out) / "latest.pt")
    model = model_of(state).to(device)
    v = config.validation
    lists = device.type == "cpu"
    validation = None
    if v.live:
        sides = open_sides(v.map, v.live, "validation")
        validation = Validation(sides, model.plan, max_live=v.max_live, max_map=v.max_map, lists=lists)
    corpus = open_corpus(config.data.train, "data.train")
    history = train_head(model, corpus, config, validation, device)
    save_checkpoint(
        Path(config.run.out) / "head.pt", model=model, step=int(state["step"]), history=history, config=config
    )


def export(config: Config, checkpoint: Path | None = None, output: Path | None = None) -> dict[str, Any]:
    """Fits the quality head on the frozen descriptor and writes the weights file."""
    device = device_of(config.run.device)
    file = checkpoint or Path(config.run.out) / ("head.pt" if config.head.steps else "latest.pt")
    state = load_checkpoint(file)
    model = model_of(state).to(device).eval()
    q, v = config.quality, config.validation
    sides = open_sides(q.map or v.map, q.live or v.live, "quality")
    rows = np.random.default_rng([config.run.seed, 4]).permutation(len(sides.live_rows))
    rows = np.sort([int(i) for i in rows if len(sides.counterparts(int(i)))][: q.max_live]).astype(np.int64)
    sides = Sides(sides.map, sides.live, sides.map_rows, sides.live_rows[rows], sides.truth)
    live = describe(model, sides.live, sides.live_rows, device)
    mapped = describe(model, sides.map, sides.map_rows, device)
    factor, tried = 1.0, dict[str, dict[str, float]]()
    if config.export.balance and model.plan.size_mode in ("beside", "both"):
        factor, tried = balance.balance(sides, live, mapped, model.plan.learned_dim)
        balance.apply(model, factor)
        live[:, : model.plan.learned_dim] *= np.float32(factor)
        mapped[:, : model.plan.learned_dim] *= np.float32(factor)
    quality, facts = train_quality(live, nearest_is_right(sides, live, mapped), config.run.seed)
    o, b, loss = config.optim, config.batch, config.loss
    weights = to_weights(
        model,
        quality,
        {
            **distance_thresholds(sides, live, mapped),
            "training_data": config.export.training_data,
            "training": f"{state['step']} of {o.steps} steps, batches of {b.classes} x {b.per_class}, "
            f"{loss.kind} ({loss.mining}), learning rate {o.learning_rate} to {o.learning_rate_end}, "
            f"last layers {config.head.steps} steps of {config.head.classes} x {b.per_class}, "
            f"seed {config.run.seed}",
        },
    )
    target = output or Path(config.export.weights or Path(config.run.out) / "weights.safetensors")
    write_weights(weights, target)
    balanced = {"factor": factor, "tried": tried}
    return {
        "weights": str(target),
        "balance": balanced,
        "quality": facts,
        **{k: v for k, v in weights.metadata.items() if "fpr" in k},
    }


def run(config: Config, resume: bool) -> bool:
    """Everything from the data to the judged weights."""
    if not train(config, resume):
        return False
    if int(os.environ.get("RANK", "0")) != 0:
        return True  # one process of torchrun's goes on
    if config.head.steps:
        head(config)
    report = export(config)
    print(f"weights: {report['weights']}, quality: {report['quality']}", file=sys.stderr)
    model, quality, metadata = load_network(Path(report["weights"]))
    sides = open_sides(config.validation.map, config.validation.live, "validation")
    out = Path(config.run.out) / "evaluation"
    describer = PyTorch(metadata["variant"], model, quality, device_of(config.run.device))
    print(table(evaluate([describer], sides, out)))
    return True


def random_network(plan: Plan) -> tuple[EsmNet, QualityHead]:
    """Untrained weights with running statistics and batch norms that are not trivial."""
    model, head = EsmNet(plan), QualityHead(plan.descriptor_dim)
    with torch.no_grad():
        for module in model.modules():
            if isinstance(module, torch.nn.BatchNorm1d):
                assert module.running_mean is not None and module.running_var is not None
                module.running_mean.normal_(0.0, 0.1)
                module.running_var.uniform_(0.5, 1.5)
                module.weight.uniform_(0.7, 1.3)
                module.bias.normal_(0.0, 0.1)
        for name, parameter in model.named_parameters():
            if "size" in name:
                parameter.normal_(0.0, 0.1)
        model.fc3_bias.normal_(0.0, 0.1)
        model.measures_mean.uniform_(-1.0, 1.0)
        model.measures_std.uniform_(0.5, 1.0)
        head.weight.normal_(0.0, 0.5)
        head.bias.normal_(0.0, 0.5)
    head.temperature = 1.25
    return model.eval(), head.eval()
