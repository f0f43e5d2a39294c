"""Sets that `esm-cli segments` writes are read here: one format, two programs."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from esm_train.cli import main


def test_sets_of_the_command_line(tmp_path: Path) -> None:
    program = os.environ.get("ESM_CLI")
    if program is None:
        if os.environ.get("CI") == "true":
            pytest.fail("ESM_CLI must name the program")
        pytest.skip("ESM_CLI does not name the program: build esm-cli and set it")
    place, segments = tmp_path / "wood", tmp_path / "set"
    simulate = [program, "simulate", "train-forest", "--seed", "104", "--scale", "0.03", "-o", str(place)]
    subprocess.run(simulate, check=True, capture_output=True)
    cut = [program, "segments", str(place), "--accumulate", "6", "--step", "4", "-o", str(segments)]
    subprocess.run(cut, check=True, capture_output=True)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(segments)])
    assert ended.value.code == 0
