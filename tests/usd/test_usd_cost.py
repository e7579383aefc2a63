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


@pytest.mark.slow
def test_memory_does_not_grow_with_frames(tmp_path):
    """40 frames more are 45 MB of samples more; the peak is that of a chunk."""
    few, many = cost(tmp_path / "few", 6, 10), cost(tmp_path / "many", 6, 50)
    assert many["bytes"] - few["bytes"] > 40e6
    assert many["peak"] - few["peak"] < 20e6


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """100 feathers of 3,000 points, 240 frames, and the same bytes raw."""
    folder = tmp_path_factory.mktemp("cost")
    cost(folder / "warm", 1, 1)
    figures = cost(folder / "large", 100, 240)
    print(figures)
    assert figures["points"] > 3000
    assert figures["bytes"] > 4e9
    return figures


@pytest.mark.slow
def test_a_hundred_feathers_within_three_times_a_raw_write(large):
    """The goal; docs/usd.md has what was measured. It asks for a quiet machine."""
    assert large["seconds"] < 3 * large["raw"]


@pytest.mark.slow
def test_a_hundred_feathers_within_300_megabytes(large):
    """The goal; docs/usd.md has what was measured: 220 MB stand before the first value."""
    assert large["peak"] < 300e6
