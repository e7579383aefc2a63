"""A few inputs of each kind end with a message, or are done; `.ci/nightly` tries more of them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def find_outcomes(tmp_path, *arguments):
    """Run cases in a process of its own, which has no threads; their outcomes."""
    command = [sys.executable, "-m", "tests.fuzz", *arguments, "--json", tmp_path / "found.json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (found,) = json.loads((tmp_path / "found.json").read_text())
    return found


LONG = [pytest.param(each, marks=pytest.mark.nightly) for each in ("extreme", "requests")]


@pytest.mark.parametrize("kind", ["pictures", "toml", "usd", *LONG])
def test_damaged_inputs_are_done_or_refused(tmp_path, kind):
    found = find_outcomes(tmp_path, kind, "--cases", "12", "--seconds", "1", "--seed", "11")
    assert found["cases"] > 0
    assert set(found["outcomes"]) <= {"done", "refused"}
