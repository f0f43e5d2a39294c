"""Manners towards the interpreter: other threads run, Ctrl-C is heard, forks work, results are frozen."""

from __future__ import annotations

import multiprocessing
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import esm_py
from conftest import CONFIG, World

BIG = """
    import numpy as np
    rng = np.random.default_rng(1)
    big = np.c_[rng.uniform(-300, 300, (8_000_000, 2)), rng.uniform(0, 20, 8_000_000)].astype(np.float32)
"""
# A shell's background jobs are started deaf to Ctrl-C, and hand that on.
LISTENING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
LONG = {
    "simulate": "esm_py.simulate('train-urban', 5, folder, scale=4.0)",
    "segment": "[esm_py.segment(big, config) for _ in range(100)]",
    "prior cloud": "[esm_py.MapBuilder().push_prior_cloud([0, 0, 0], big) for _ in range(100)]",
    "iteration": "[[sweep for sweep in esm_py.Recording(world)] for _ in range(10_000)]",
}


@pytest.mark.parametrize("what", LONG)
def test_ctrl_c_is_heard(what: str, world: World, tmp_path: Path) -> None:
    script = f"""
{LISTENING}
import sys, time, esm_py
folder, world = sys.argv[1:]
config = esm_py.Config({{"segment": {{"voxel": 0.05, "tolerance": 2.0}}}})
{textwrap.dedent(BIG) if "big" in LONG[what] else ""}
print("begin", flush=True)
try:
    {LONG[what]}
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    command = [sys.executable, "-c", script, str(tmp_path / "out"), str(world.folder / "map.mcap")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None and run.stdout.readline() == "begin\n"
        time.sleep(1.5)
        assert run.poll() is None, "it is still at work"
        pressed = time.monotonic()
        run.send_signal(signal.SIGINT)
        assert run.stdout.readline() == "interrupted\n"
        waited = time.monotonic() - pressed
        run.kill()
    # On an idle machine a twentieth of a second, and up to one for a simulation, whose batch of sweeps is waited for.
    # Busy ones are given time; the work itself would take minutes.
    assert waited < (15.0 if what == "simulate" else 3.0), f"{waited:.2f} s"


def test_an_interrupted_simulation_can_go_on(tmp_path: Path) -> None:
    script = f"""
{LISTENING}
import sys, esm_py
print('begin', flush=True)
esm_py.simulate('train-forest', 3, sys.argv[1], scale=0.05)
"""
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None and run.stdout.readline() == "begin\n"
        time.sleep(1.5)
        run.send_signal(signal.SIGINT)
        _, told = run.communicate()
    assert "KeyboardInterrupt" in told
    assert (tmp_path / "unfinished.toml").exists() and (tmp_path / ".map.mcap.part").exists()
    made = esm_py.simulate("train-forest", 3, tmp_path, scale=0.05)
    assert made.sweeps == 200


def busy_work(world: World, folder: Path) -> dict[str, Callable[[], Any]]:
    rng = np.random.default_rng(1)
    big = np.c_[rng.uniform(-150, 150, (2_000_000, 2)), rng.uniform(0, 10, 2_000_000)].astype(np.float32)
    cloud = esm_py.LiveCloud(0.0, world.recording("map").sweeps().__next__().points)
    localizer = esm_py.Localizer(world.map, CONFIG)
    return {
        "simulate": lambda: esm_py.simulate("train-forest", 9, folder, scale=0.02),
        "segment": lambda: esm_py.segment(big),
        "localize": lambda: [localizer.localize(cloud) for _ in range(20)],
        "iterate": lambda: list(world.recording("map")),
        "open": lambda: [esm_py.Map.open(world.map_file) for _ in range(500)],
    }


@pytest.mark.parametrize("what", ["simulate", "segment", "localize", "iterate", "open"])
def test_other_threads_run_meanwhile(what: str, world: World, tmp_path: Path) -> None:
    work = busy_work(world, tmp_path)[what]
    ticks: list[float] = []
    done = threading.Event()

    def tick() -> None:
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    ticking = threading.Thread(target=tick)
    ticking.start()
    began = time.monotonic()
    work()
    took = time.monotonic() - began
    done.set()
    ticking.join()
    inside = [t for t in ticks if began <= t <= began + took]
    # Held throughout, the interpreter would have let the other thread in a few times at most.
    assert len(inside) > 5 * took, f"{len(inside)} ticks in {took:.2f} s"
    longest = max(np.diff([began, *inside, began + took]))
    assert longest < max(1.5, 0.6 * took), f"{longest:.2f} s of {took:.2f} s without a tick"


def test_several_threads_may_use_one_object(world: World) -> None:
    cloud = esm_py.LiveCloud(0.0, next(world.recording("live").sweeps()).points)
    localizer = esm_py.Localizer(world.map, CONFIG)
    scores: list[float] = []
    threads = [threading.Thread(target=lambda: scores.append(localizer.localize(cloud).score)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(scores) == 8 and len(set(scores)) == 1


def in_child(send: Any) -> None:
    column = np.c_[np.zeros((200, 2)), np.linspace(0, 4, 200)]
    send.send([len(esm_py.segment(column, threads=threads).structure) for threads in (None, 1, 2)])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_forked_processes_have_threads_of_their_own(hall: Any) -> None:
    esm_py.segment(hall)
    esm_py.segment(hall, threads=2)
    receive, send = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=in_child, args=(send,))
    child.start()
    assert receive.poll(30), "it hangs"
    first, second, third = receive.recv()
    child.join()
    assert first == second == third > 0


def results(world: World, folder: Path) -> list[Any]:
    accumulator = esm_py.Accumulator(CONFIG)
    sweep = next(world.recording("live", labels=True).sweeps())
    live = accumulator.push_sweep(sweep)
    assert live is not None
    cut = esm_py.segment(live.points)
    shape = esm_py.Descriptor("shape")
    described = shape.describe(cut)
    index = esm_py.Index(world.map.descriptors)
    found = esm_py.candidates(cut, described, world.map, index, CONFIG)
    scan = folder / "a.bin"
    scan.write_bytes(np.ones((5, 4), "<f4").tobytes())
    surveyor = esm_py.Surveyor(CONFIG.replace({"accumulate": {"distance_m": 0.0}}))
    survey = surveyor.push_sweep(sweep, np.eye(4))
    localizer = esm_py.Localizer(world.map, CONFIG)
    answer = localizer.localize(live)
    assert survey and world.map.standardizer is not None
    return [
        CONFIG,
        sweep,
        live,
        cut,
        cut.segments[0],
        shape,
        described,
        index,
        found,
        answer,
        survey[0],
        world.map,
        world.map.descriptor_info,
        world.map.standardizer,
        world.recording("live"),
        world.recording("live").topics[0],
        world.recording("live").sweeps(),
        accumulator,
        localizer,
        esm_py.SequenceLocalizer(localizer),
        surveyor,
        esm_py.MapBuilder(),
        esm_py.LoopFinder(),
        esm_py.Identities(),
        esm_py.Preset("kitti"),
        esm_py.read_scan(scan),
        esm_py.read_prior_cloud(scan),
        esm_py.read_tum(world.folder / "map_truth.tum"),
        *answer.matches[:1],
        *esm_py.search(found, CONFIG)[:1],
    ]


def test_results_are_frozen_and_readable(world: World, tmp_path: Path) -> None:
    seen = set()
    for result in results(world, tmp_path):
        kind = type(result)
        seen.add(kind.__name__)
        assert kind.__module__ == "esm_py" and getattr(esm_py, kind.__name__) is kind
        text = repr(result)
        assert text.startswith((kind.__name__ + "(", "<sweeps of ")) and " object at 0x" not in text, text
        assert "\n" not in text and len(text) < 250, text
        for name in [n for n in dir(kind) if not n.startswith("_")]:
            value = getattr(result, name)
            if callable(value):
                continue
            with pytest.raises(AttributeError):
                setattr(result, name, value)
            if isinstance(value, np.ndarray):
                assert not value.flags.writeable and value.flags.c_contiguous and value.flags.aligned, name
                with pytest.raises(ValueError, match="read-only"):
                    value[...] = 0
                np.testing.assert_array_equal(getattr(result, name), value)
        with pytest.raises(AttributeError):
            result.surprise = 1
    assert {"Sweep", "LiveCloud", "Localization", "Map", "Found", "Segment"} <= seen


def test_readme_of_a_localization(world: World) -> None:
    live = esm_py.LiveCloud(12.5, np.ones((10, 3)))
    answer = esm_py.Localizer(world.map, CONFIG).localize(live)
    assert repr(answer) == (
        'Localization(stamp=12.500000, verdict="not_found", pose_map_sensor=None, inliers=0, score=0.00, runner_up=0.00)'
    )
    assert answer.pose_map_sensor is None and answer.covariance is None and answer.reason
    assert answer.matches == [] and not answer.located and answer.runner_up_pose_map_sensor is None
    assert list(answer.timings)[:2] == ["accumulation", "segmentation"]


def test_memory_is_given_back(world: World) -> None:
    """A long iteration does not grow: sweeps are freed when they are let go."""
    resource = pytest.importorskip("resource")

    def peak() -> float:
        return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024

    recording = world.recording("map")
    for _ in recording:
        pass
    before = peak()
    for _ in range(3):
        for sweep in recording:
            assert sweep.points.size
    assert peak() < before + 100
