"""A few damaged inputs of each kind end with a message, or are done; `.ci/nightly` tries more."""

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


@pytest.mark.parametrize("kind", ["pictures", "toml", "usd"])
def test_damaged_inputs_are_done_or_refused(tmp_path, kind):
    found = find_outcomes(tmp_path, kind, "--cases", "40", "--seconds", "3", "--seed", "11")
    assert found["cases"] > 0
    assert set(found["outcomes"]) <= {"done", "refused"}


@pytest.mark.nightly
def test_killed_commands_leave_what_undisturbed_ones_leave(tmp_path):
    found = find_outcomes(tmp_path, "kill", "--cases", "110", "--seed", "12")
    assert found["outcomes"]["done"] == 110
    assert found["outcomes"]["killed"] > 0


@pytest.mark.nightly
def test_extreme_shots_pass_no_bound_without_a_word(tmp_path):
    hour = "--cases", "1000", "--jobs", "2", "--seconds", "3600", "--seed", "13"
    found = find_outcomes(tmp_path, "extreme", *hour)
    assert set(found["outcomes"]) <= {"done", "named"}
    assert found["outcomes"]["done"] > 0.5 * found["cases"]
