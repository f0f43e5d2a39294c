"""Sets that `esm-cli segments` writes are read here: one format, two programs."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from conftest import needed

from esm_train.cli import main


def test_sets_of_the_command_line(tmp_path: Path) -> None:
    program = needed("ESM_CLI")
    place, segments = tmp_path / "wood", tmp_path / "set"
    simulate = [program, "simulate", "train-forest", "--seed", "104", "--scale", "0.03", "-o", str(place)]
    subprocess.run(simulate, check=True, capture_output=True)
    cut = [program, "segments", str(place), "--accumulate", "6", "--step", "4", "-o", str(segments)]
    subprocess.run(cut, check=True, capture_output=True)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(segments)])
    assert ended.value.code == 0
