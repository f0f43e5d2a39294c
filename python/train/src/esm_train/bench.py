"""Segments a second: forward pass and training step of full and down-sampled network, and the making of inputs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from esm_train.augment import Augmentation
from esm_train.config import BatchConfig, LossConfig, OptimConfig
from esm_train.corpus import BatchSampler, Corpus
from esm_train.inputs import Inputs, TrainingBatches
from esm_train.losses import descriptor_loss
from esm_train.model import EsmNet, parameter_groups
from esm_train.plan import SWIFT_POINTS, plan_for
from esm_train.segments import SegmentSet
from esm_train.synthetic import write_synthetic

PLANS = {
    "esm (256,256,256,256)": ("esm", None),
    "esm-swift (256,96,64,48)": ("esm-swift", SWIFT_POINTS),
    "esm-swift (128,64,64,48)": ("esm-swift", (128, 64, 64, 48)),
}


def best_of(call: Callable[[], object], repeat: int) -> float:
    """Smallest time in seconds of `repeat` calls, after one that does not count."""
    call()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def bench(device: torch.device, classes: int, repeat: int) -> str:
    """A table in Markdown: segments a second."""
    lines = [
        f"{torch.get_num_threads()} threads, {device}, batches of {2 * classes}, best of {repeat}",
        "",
        "| plan | M multiply-adds | inputs (one worker) | forward fp32 | step fp32 | step bf16 |",
        "|---|---|---|---|---|---|",
    ]
    with TemporaryDirectory() as temporary:
        path = Path(temporary) / "segments"
        write_synthetic(path, objects=2 * classes, observations=2)
        sampler = BatchSampler(Corpus([SegmentSet(path)]), BatchConfig(classes=classes), 0)
        for name, (variant, points) in PLANS.items():
            plan = plan_for(variant, points=points)
            batches = TrainingBatches(sampler, plan, Augmentation(), rank=0, lists=device.type == "cpu")
            inputs = batches[0].to(device, plan)
            labels = batches.labels().to(device)
            model = EsmNet(plan).to(device)
            optimizer = torch.optim.Adam(parameter_groups(model, OptimConfig().weight_decay))

            def finished() -> None:
                if device.type == "cuda":
                    torch.cuda.synchronize()

            def forward(model: EsmNet = model, inputs: Inputs = inputs) -> None:
                model.eval()
                with torch.no_grad():
                    model(inputs.points, inputs.neighbours, inputs.measures)
                finished()

            def step(
                model: EsmNet = model,
                inputs: Inputs = inputs,
                optimizer: torch.optim.Optimizer = optimizer,
                labels: torch.Tensor = labels,
                *,
                bf16: bool = False,
            ) -> None:
                model.train()
                with torch.autocast(device.type, torch.bfloat16, enabled=bf16):
                    d = model(inputs.points, inputs.neighbours, inputs.measures)
                optimizer.zero_grad(set_to_none=True)
                descriptor_loss(d, labels, LossConfig()).total.backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                finished()

            def make(batches: TrainingBatches = batches) -> None:
                batches[1]

            seconds = [best_of(call, repeat) for call in (make, forward, step, lambda step=step: step(bf16=True))]
            rates = " | ".join(f"{2 * classes / s:.0f}" for s in seconds)
            lines.append(f"| {name} | {plan.multiply_adds() / 1e6:.1f} | {rates} |")
    return "\n".join(lines)
