"""Bakes of the samples through the command line: what is written, and what is not."""

import json

import pytest
from commands import invoke
from places import SAMPLES

from featherfx.cli.progress import Progress

PULL = SAMPLES / "feather_pull/shot.toml"


def test_bake_writes_a_sound_cache_and_a_report(tmp_path):
    output, report = tmp_path / "pull.usdc", tmp_path / "pull.json"
    result = invoke("bake", PULL, "-o", output, "--frames", "1-3", "--report", report)
    assert result.exit_code == 0, result.stderr
    assert "frames: 3 of 3" in result.stderr
    assert sorted(tmp_path.iterdir()) == [report, output]
    assert invoke("check", "--strict", output).exit_code == 0
    figures = json.loads(report.read_text())
    assert (figures["feathers"], figures["frames"]) == (1, 3)
    assert figures["simulated_seconds"] == pytest.approx(2 / 24)
    assert figures["wall_seconds"] > 0
    assert figures["peak_memory_bytes"] > 1e7
    for key in ("newton_iterations", "substeps"):
        assert figures[key]["max"] >= figures[key]["mean"] > 0
    assert figures["worst_residual"] >= 0
    assert isinstance(figures["skipped"], dict)


def test_jobs_do_not_change_a_byte(tmp_path):
    written = []
    for jobs in (1, 2):
        output = tmp_path / str(jobs) / "wing.usdc"
        output.parent.mkdir()
        shot = SAMPLES / "swan_wing/shot.toml"
        result = invoke("bake", shot, "-o", output, "--frames", "1-2", "--jobs", jobs, "--strict")
        assert result.exit_code == 0, result.stderr
        written.append(output.read_bytes())
    assert written[0] == written[1]


def test_an_interrupt_leaves_nothing_new_and_the_old_file_whole(tmp_path, monkeypatch):
    def interrupt(self, done, total):
        if done == 2:
            raise KeyboardInterrupt

    output = tmp_path / "pull.usdc"
    output.write_bytes(b"old")
    monkeypatch.setattr(Progress, "__call__", interrupt)
    report = tmp_path / "pull.json"
    command = ("bake", PULL, "-o", output, "--frames", "1-3", "--overwrite", "--report", report)
    result = invoke(*command)
    assert result.exit_code == 1
    assert result.stderr == "featherfx: interrupted: nothing was written\n"
    assert [file.name for file in tmp_path.iterdir()] == ["pull.usdc"]
    assert output.read_bytes() == b"old"


def test_an_output_that_exists_is_refused_before_any_work(tmp_path):
    output = tmp_path / "pull.usdc"
    output.write_bytes(b"old")
    result = invoke("bake", PULL, "-o", output)
    assert result.exit_code == 1
    assert "--overwrite" in result.stderr
    assert "frames:" not in result.stderr
    assert output.read_bytes() == b"old"


def test_all_problems_of_a_bake_are_told_at_once(tmp_path):
    result = invoke(
        *("bake", PULL, "-o", tmp_path / "no/pull.abc", "--frames", "0-400"),
        *("--quality", "drft", "--report", tmp_path / "missing/r.json"),
    )
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    told = (
        "0-400 is out of range. Give frames from 1 to 25",
        "did you mean 'draft'",
        "'.abc'",
        "missing",
    )
    for part in told:
        assert sum(part in line for line in lines) == 1, part
