"""What a large cache costs: memory does not grow with its frames, time stays within bounds."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parent / "writing_cost.py"


def cost(folder: Path, feathers: int, frames: int) -> dict[str, float]:
    folder.mkdir()
    run = [sys.executable, str(PROGRAM), str(folder), str(feathers), str(frames), "clips"]
    return json.loads(subprocess.run(run, capture_output=True, check=True).stdout)


def test_memory_does_not_grow_with_frames(tmp_path):
    """60 frames more are 67 MB of samples more; the peak is that of a chunk."""
    few, many = cost(tmp_path / "few", 6, 30), cost(tmp_path / "many", 6, 90)
    assert many["bytes"] - few["bytes"] > 60e6
    assert many["peak"] - few["peak"] < 20e6


@pytest.mark.slow
def test_writing_a_hundred_feathers(tmp_path):
    """At most three times a raw write of the same bytes; docs/usd.md has the figures.

    The time asks for a quiet machine: computing competes for processors, a raw write hardly does.
    Of the peak 240 MiB are libraries.
    """
    cost(tmp_path / "warm", 1, 1)
    figures = cost(tmp_path / "large", 100, 240)
    print(figures)
    assert figures["points"] > 3000
    assert figures["bytes"] > 4e9
    assert figures["peak"] < 320e6
    assert figures["seconds"] < 3 * figures["raw"]
