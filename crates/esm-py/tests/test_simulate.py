"""Simulated worlds: the command line's bytes; stopped, gone on with, never in each other's way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import esm_py
from conftest import Cli
from esm_py.errors import (
    BusyError,
    ExistsError,
    FileError,
    InterruptedSimulationError,
    ScaleError,
    SettingError,
    UnknownPresetError,
)

FILES = {"map.mcap", "live.mcap", "map_truth.tum", "live_truth.tum", "preset.toml"}


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_the_command_lines_bytes_on_any_number_of_threads(cli: Cli, tmp_path: Path) -> None:
    heard: list[esm_py.Progress] = []
    made = esm_py.simulate("train-forest", 7, tmp_path / "ours", scale=0.01, threads=1, progress=heard.append)
    esm_py.simulate(esm_py.Preset("train-forest"), 7, tmp_path / "two", scale=0.01, threads=2)
    cli.run("simulate", "train-forest", "--seed", "7", "--scale", "0.01", "-o", tmp_path / "cli")
    ours = contents(tmp_path / "ours")
    assert set(ours) == FILES
    assert ours == contents(tmp_path / "two") == contents(tmp_path / "cli")
    assert made.sweeps == 40 and made.points > 100_000 and made.rays > made.points and made.kept == made.discarded == 0
    assert {p.visit for p in heard} == {"map", "live"} and heard[-1].done == heard[-1].total == 20


def test_other_drives_are_the_command_lines_too(cli: Cli, tmp_path: Path) -> None:
    ours = tmp_path / "ours"
    esm_py.simulate("train-forest", 7, ours, scale=0.01, live_reversed=True, live_offset=2.0, live_changed=0.3)
    flags = ("--live-reversed", "--live-offset", "2", "--live-changed", "0.3")
    cli.run("simulate", "train-forest", "--seed", "7", "--scale", "0.01", *flags, "-o", tmp_path / "cli")
    assert contents(ours) == contents(tmp_path / "cli")
    with pytest.raises(ExistsError, match="live reversed, live offset 2, live changed 0.3"):
        esm_py.simulate("train-forest", 7, ours, scale=0.01)
    with pytest.raises(SettingError, match="-20 to 20 m"):
        esm_py.simulate("train-forest", 7, tmp_path / "far", scale=0.01, live_offset=50.0)


def test_stopped_and_gone_on_with(tmp_path: Path) -> None:
    esm_py.simulate("train-forest", 7, tmp_path / "whole", scale=0.03, threads=1)

    def stop(progress: esm_py.Progress) -> bool:
        return progress.done < 10

    with pytest.raises(InterruptedSimulationError, match="hint: run it again"):
        esm_py.simulate("train-forest", 7, tmp_path / "part", scale=0.03, progress=stop)
    assert (tmp_path / "part" / "unfinished.toml").exists()
    made = esm_py.simulate("train-forest", 7, tmp_path / "part", scale=0.03)
    assert made.kept > 0 and contents(tmp_path / "part") == contents(tmp_path / "whole")


def test_an_exception_of_the_callback_comes_out(tmp_path: Path) -> None:
    def fail(_: esm_py.Progress) -> None:
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        esm_py.simulate("train-forest", 7, tmp_path, scale=0.02, progress=fail)
    # And nothing is at work there any more.
    assert esm_py.simulate("train-forest", 7, tmp_path, scale=0.02).sweeps == 80


def test_nothing_foreign_is_replaced(tmp_path: Path) -> None:
    made = esm_py.simulate("train-forest", 1, tmp_path / "a", scale=0.005)
    before = contents(tmp_path / "a")
    again = esm_py.simulate("train-forest", 1, tmp_path / "a", scale=0.005)
    assert again.points == made.points and contents(tmp_path / "a") == before
    with pytest.raises(ExistsError, match="another simulation: train-forest, seed 1.*\nhint: .*force=True") as caught:
        esm_py.simulate("train-forest", 2, tmp_path / "a", scale=0.005)
    assert isinstance(caught.value, FileExistsError)
    esm_py.simulate("train-forest", 2, tmp_path / "a", scale=0.005, force=True)
    assert contents(tmp_path / "a") != before
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "map.mcap").write_text("mine")
    with pytest.raises(ExistsError, match="map.mcap: it exists"):
        esm_py.simulate("train-forest", 1, tmp_path / "b", scale=0.005)
    assert (tmp_path / "b" / "map.mcap").read_text() == "mine"


def test_two_in_one_directory(tmp_path: Path) -> None:
    def inside(_: esm_py.Progress) -> None:
        with pytest.raises(BusyError, match="another simulation is writing here"):
            esm_py.simulate("train-forest", 1, tmp_path, scale=0.005)

    esm_py.simulate("train-forest", 1, tmp_path, scale=0.005, progress=inside)


def test_what_cannot_be_simulated(tmp_path: Path) -> None:
    with pytest.raises(UnknownPresetError, match="no preset is called 'mars'\nhint: the presets are burgess"):
        esm_py.simulate("mars", 1, tmp_path)
    for scale in (0.0, 5.0, float("nan")):
        with pytest.raises(ScaleError, match="is not within"):
            esm_py.simulate("kitti", 1, tmp_path, scale=scale)
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="file"):
        esm_py.simulate("kitti", 1, tmp_path / "file", scale=0.005)
    arguments: list[tuple[Any, Any, dict[str, Any]]] = [
        (5, 1, {}),
        ("kitti", "1", {}),
        ("kitti", 1.5, {}),
        ("kitti", 1, {"progress": 3}),
        ("kitti", 1, {"threads": "two"}),
    ]
    for preset, seed, named in arguments:
        with pytest.raises(TypeError):
            esm_py.simulate(preset, seed, tmp_path / "none", **named)
    with pytest.raises(OverflowError):
        esm_py.simulate("kitti", -1, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_presets() -> None:
    assert "kitti" in esm_py.PRESETS
    for name in esm_py.PRESETS:
        preset = esm_py.Preset(name)
        assert preset.name == name and preset.about and preset.sensor
        assert preset.length_m > 0 and preset.sensor_height_m > 0 and preset.speed_mps > 0
        assert preset.spacing_m >= 0 and preset.accumulate_m >= 0
    assert esm_py.CLASSES[10] == "tree" and esm_py.UNKNOWN_CLASS not in esm_py.CLASSES
