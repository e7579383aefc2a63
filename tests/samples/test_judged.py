"""Samples keep the bounds of the judge in what is written; those that do not are pinned."""

import json

import pytest
from commands import invoke
from places import SAMPLES

import featherfx
from featherfx.usd.check import judge

# bounds that a sample passes; an entry goes when they are kept
PASSED = {
    # lips of open splits keep no lengths, and snap apart as they open
    "torn_feather": {"lengths", "pops"}
}
# the other small ones are baked by tests/cli/test_samples_bake.py
SMALL = {"breeze": 4, "wet_feather": 2}
NIGHTLY = {
    **dict.fromkeys(("first_bird", "pigeon", "owl_flight", "peacock", "flapping_bird"), 3),
    "torn_feather": 28,
}
PREVIEW = {"torn_feather"}  # splits at draft come late


@pytest.mark.parametrize(
    ("sample", "frames"),
    [*SMALL.items(), *(pytest.param(*each, marks=pytest.mark.nightly) for each in NIGHTLY.items())],
)
def test_a_sample_keeps_the_bounds(tmp_path, sample, frames):
    shot, path = SAMPLES / sample / "shot.toml", tmp_path / "cache.usdc"
    report = featherfx.bake(
        shot, path, frames=(1, frames), quality="preview" if sample in PREVIEW else "draft"
    ).report
    passed = {
        "lengths": report["lengths"]["feathers_over"] > 0,
        "pops": report["pops"]["unexplained"] > 0,
        "velocities": any("velocities" in text for text in report["bounds_passed"]),
    }
    assert {name for name, is_passed in passed.items() if is_passed} == PASSED.get(sample, set())


def test_a_bake_that_passes_a_bound_warns_and_is_strict_where_asked(tmp_path, monkeypatch):
    monkeypatch.setattr(judge, "MAX_SIMULATED_LENGTH_ERROR", 1e-5)
    path, report = tmp_path / "pull.usdc", tmp_path / "pull.json"
    shot = SAMPLES / "feather_pull/shot.toml"
    told = invoke("bake", shot, "-o", path, "--frames", "1-6", "--report", report, "--strict")
    assert told.exit_code == 1
    figures = json.loads(report.read_text())
    worst = figures["lengths"]["worst"][0]
    assert f"{worst['feather']} at frame {worst['frame']:g}" in told.stderr
    assert f"featherfx: warning: {figures['bounds_passed'][0]}" in told.stderr
    assert figures["seconds"]["finishing"] >= figures["phases"]["judging"]
    # the cache is whole, and by its own bounds in order
    monkeypatch.undo()
    assert invoke("check", "--strict", path).exit_code == 0
