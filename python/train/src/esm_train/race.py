"""The forward pass side by side: PyTorch, ONNX Runtime and the Rust network on the same weights, inputs and threads."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from esm_train.errors import TrainError
from esm_train.golden import golden_inputs, write_golden
from esm_train.inputs import Inputs
from esm_train.model import EsmNet
from esm_train.weights import load_network


class _Flat(nn.Module):
    """The network with its neighbour lists as plain arguments, as exporters want them."""

    def __init__(self, model: EsmNet) -> None:
        super().__init__()
        self.model = model

    def forward(self, points: Tensor, n1: Tensor, n2: Tensor, n3: Tensor, n4: Tensor, measures: Tensor) -> Tensor:
        descriptor: Tensor = self.model(points, [n1, n2, n3, n4], measures)
        return descriptor


def race(weights: Path, program: Path, threads: int, segments: int, rounds: int) -> dict[str, Any]:
    """Seconds for `segments` segments, best and median of `rounds`, one program after the other in every round.

    PyTorch and ONNX Runtime are given the neighbour lists; the Rust program (`cargo build --release -p esm-benches
    --example forward`) looks for them itself.
    """
    torch.set_num_threads(threads)
    model, head, _ = load_network(weights)
    model.eval()
    inputs = golden_inputs(model, segments, seed=1)
    with TemporaryDirectory() as temporary:
        golden = Path(temporary) / "golden.safetensors"
        write_golden(model, head, weights, golden, count=segments, seed=1)
        runners: dict[str, Callable[[], float]] = {
            "PyTorch": lambda: _timed(lambda: _eager(model, inputs)),
            "ONNX Runtime": _onnx(model, inputs, Path(temporary) / "network.onnx", threads),
            "esm": lambda: _rust(program, weights, golden, threads),
        }
        times: dict[str, list[float]] = {name: [] for name in runners}
        for number in range(rounds + 1):
            for name, call in runners.items():
                seconds = call()
                if number:  # The first round warms up.
                    times[name].append(seconds)
    best = {name: min(t) for name, t in times.items()}
    return {
        "weights": weights.name,
        "variant": model.plan.variant,
        "multiply_adds": model.plan.multiply_adds(),
        "segments": segments,
        "threads": threads,
        "rounds": rounds,
        "best_ms": {name: round(1e3 * t, 2) for name, t in best.items()},
        "median_ms": {name: round(1e3 * statistics.median(t), 2) for name, t in times.items()},
        "faster_than": {name: round(t / best["esm"], 2) for name, t in best.items() if name != "esm"},
    }


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


@torch.no_grad()
def _eager(model: EsmNet, inputs: Inputs) -> None:
    model(inputs.points, inputs.neighbours, inputs.measures)


def _onnx(model: EsmNet, inputs: Inputs, file: Path, threads: int) -> Callable[[], float]:
    try:
        import onnxruntime
    except ImportError:
        raise TrainError("ONNX Runtime is not installed", "uv run --group race esm-train race ...") from None
    arguments = (inputs.points, *(n.long() for n in inputs.neighbours), inputs.measures)
    with torch.no_grad():
        torch.onnx.export(_Flat(model).eval(), arguments, str(file), dynamo=True, verbose=False)
        want = model(inputs.points, inputs.neighbours, inputs.measures).numpy()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    feeds = {i.name: a.numpy() for i, a in zip(session.get_inputs(), _used(arguments, session), strict=True)}
    (found,) = session.run(None, feeds)
    off = float(np.abs(found - want).max())
    if off > 1e-3:
        raise TrainError(f"the exported network is off by {off}")
    return lambda: _timed(lambda: session.run(None, feeds))


def _used(arguments: tuple[Tensor, ...], session: Any) -> tuple[Tensor, ...]:
    """The arguments that the exported network kept: without metric size there is no input for it."""
    return arguments[: len(session.get_inputs())]


def _rust(program: Path, weights: Path, golden: Path, threads: int) -> float:
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
    call = [str(program), str(weights), str(golden), "--repeat", "2"]
    try:
        done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        detail = getattr(error, "stderr", "") or str(error)
        hint = "cargo build --release -p esm-benches --example forward"
        raise TrainError(f"{program}: {detail.strip()}", hint) from None
    return float(min(json.loads(done.stdout)["seconds"]))


def table(report: dict[str, Any]) -> str:
    """The report in Markdown."""
    lines = [
        f"{report['variant']}, {report['segments']} segments of {report['multiply_adds'] / 1e6:.1f} M multiply-adds, "
        f"{report['threads']} thread(s), best and median of {report['rounds']} rounds",
        "",
        "| | best (ms) | median (ms) | esm is faster by |",
        "|---|--:|--:|--:|",
    ]
    for name, best in report["best_ms"].items():
        factor = report["faster_than"].get(name)
        lines.append(f"| {name} | {best:.1f} | {report['median_ms'][name]:.1f} | {'' if factor is None else factor} |")
    return "\n".join(lines)
