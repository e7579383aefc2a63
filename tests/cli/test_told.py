"""What commands say of long work: phases, times, warnings, interrupts."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Usd, UsdGeom, Vt

from featherfx.baking import bake as baking
from featherfx.baking import pipeline
from featherfx.cli.progress import about
from featherfx.lab.program import write_patch
from featherfx.phases import phase

PULL = SAMPLES / "feather_pull/shot.toml"
ON_SKIN = """
name = "patch"
groom = "groom.toml"
frames = [1, 2]
detail = [{ region = "*", level = "rigid" }]
skin = { usd = "body.usda", prim = "/skin" }
"""
PARTS = ["setting_up", "settling", "simulating", "writing", "finishing"]


def test_the_parts_of_a_report_add_up_to_the_time_of_the_command(tmp_path):
    report = tmp_path / "pull.json"
    command = [sys.executable, "-m", "featherfx", "bake", str(PULL), "-o", str(tmp_path / "p.usdc")]
    begin = time.perf_counter()
    process = subprocess.Popen(
        [*command, "--frames", "1-2", "--quality", "draft", "--report", str(report)],
        stderr=subprocess.DEVNULL,
    )
    while not report.exists() and process.poll() is None:
        time.sleep(0.002)
    wall = time.perf_counter() - begin
    assert process.wait() == 0
    told = json.loads(report.read_text())
    assert list(told["seconds"]) == PARTS
    assert sum(told["seconds"].values()) == pytest.approx(told["wall_seconds"], rel=1e-6)
    # what lies between is the time of a process to begin, and of a file to appear
    assert told["wall_seconds"] == pytest.approx(wall, rel=0.03, abs=0.3)
    assert sum(told["phases"].values()) == pytest.approx(told["wall_seconds"], rel=1e-6)


def test_an_interrupt_before_the_bake_says_in_what(monkeypatch, tmp_path):
    def interrupted(*arguments):
        with phase("layout", 10):
            raise KeyboardInterrupt

    monkeypatch.setattr(baking, "prepare", interrupted)
    result = invoke("bake", PULL, "-o", tmp_path / "p.usdc")
    assert result.exit_code == 1
    assert result.stderr == "featherfx: interrupted during layout: nothing was written\n"


def test_an_interrupt_after_the_last_rename_says_that_the_cache_is_complete(monkeypatch, tmp_path):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(baking, "store_report", interrupted)
    output, report = tmp_path / "p.usdc", tmp_path / "p.json"
    result = invoke("bake", PULL, "-o", output, "--frames", "1-2", "--report", report)
    assert result.exit_code == 1
    told = f"featherfx: interrupted, but {output} is complete; {report} was not written"
    assert result.stderr.splitlines()[-1] == told
    assert output.exists()


def test_an_interrupt_of_another_command_says_in_what(monkeypatch, tmp_path):
    def interrupted(*arguments):
        with phase("checking", 10):
            raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "check", interrupted)
    result = invoke("check", PULL)
    assert (result.exit_code, result.stderr) == (1, "featherfx: interrupted during checking\n")


COUNTS = ("substeps", "substeps_with_barbs_passing", "substeps_with_hooks_slipping")


def worst(feather, frame, error, *counts):
    tolerance = {"tolerance": 1e-4, "feather": feather, "frame": frame, "error": error}
    return tolerance | dict(zip(COUNTS, counts, strict=True))


@pytest.mark.parametrize(
    ("limits", "help_told"),
    [
        ({"max_substeps": 32}, "raise max_substeps (32)"),
        (
            {"[contact] max_steps": 8, "max_substeps": 8},
            "raise [contact] max_steps (8) and max_substeps (8)",
        ),
        (
            {"[contact] steps": 12, "max_substeps": 8},
            "leave out [contact] steps = 12, which fixes their number, and raise max_substeps (8)",
        ),
    ],
)
def test_a_warning_of_steps_says_what_was_exceeded_where_and_what_helps(
    monkeypatch, limits, help_told
):
    def bake(shot, **options):
        figures = {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}
        counts = {
            "substeps_over_tolerance": 4,
            "substeps_with_barbs_passing": 1,
            "substeps_with_hooks_slipping": 0,
            "feathers_over_tolerance": 2,
            "substep_limits": limits,
        }
        found = [worst("primary_3", 12.0, 4.2e-4, 3, 0, 0), worst("primary_1", 7.5, 1e-5, 0, 1, 2)]
        return figures | counts | {"worst_substeps": found}

    monkeypatch.setattr(pipeline, "bake", bake)
    lines = invoke("bake", "s.toml").stderr.splitlines()
    assert lines[1:] == [
        "featherfx: warning: sub-steps of 2 feathers were longer than their errors allow: 4 with a"
        " local error above the tolerance; 1 in which loose barbs pass through each other. None"
        f" shorter is allowed: {help_told}",
        "  primary_3 at frame 12: error of 0.42 mm, 4.2 times the tolerance, in 3 sub-steps",
        "  primary_1 at frame 7.5: loose barbs pass through each other in 1 sub-step, hooks slip"
        " too far in 2 sub-steps",
    ]


@pytest.mark.parametrize("over", [{}, {"down": 2.31, "covert": 1.2}])
def test_an_error_that_cannot_be_kept_is_told(monkeypatch, over):
    def bake(shot, **options):
        figures = {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}
        return figures | {"error_promised": 1.0, "over_promised": over}

    monkeypatch.setattr(pipeline, "bake", bake)
    lines = invoke("bake", "s.toml").stderr.splitlines()
    assert len(lines) == 1 + bool(over)
    if over:
        assert "an error of 1 % was asked for and cannot be kept" in lines[1]
        assert "1.2 % by covert, 2.3 % by down" in lines[1]


def test_feathers_without_a_unique_answer_are_named_by_kind(monkeypatch):
    def bake(shot, **options):
        figures = {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}
        return figures | {"undefined": {"down": [f"d{k}" for k in range(7)], "covert": ["c"]}}

    monkeypatch.setattr(pipeline, "bake", bake)
    lines = invoke("bake", "s.toml").stderr.splitlines()
    assert "8 feathers have no unique answer" in lines[1]
    assert lines[2:] == ["  covert: c", "  down: d0, d1, d2, d3, d4 and 2 more"]


def test_what_promises_no_error_says_why(monkeypatch):
    def bake(shot, **options):
        figures = {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}
        return figures | {"error_promised": None, "error_not_promised": "feathers push each other"}

    monkeypatch.setattr(pipeline, "bake", bake)
    assert invoke("bake", "s.toml").stderr.splitlines()[1:] == [
        "featherfx: no error is promised: feathers push each other"
    ]


def test_feathers_whose_steps_were_not_solved_are_named(monkeypatch):
    def bake(shot, **options):
        figures = {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}
        far = {"feather": "primary_3", "frame": 12.0, "distance": 0.0123}
        return figures | {"feathers_unsolved": 1, "worst_unsolved": [far]}

    monkeypatch.setattr(pipeline, "bake", bake)
    _, warning, where = invoke("bake", "s.toml").stderr.splitlines()
    assert "1 feather has sub-steps that were not solved" in warning
    assert where == "  primary_3 at frame 12: 12.3 mm from the solution"


def test_a_bake_names_the_feathers_whose_steps_were_too_long(tmp_path):
    shot = tmp_path / "shot.toml"
    groom = (SAMPLES / "feather_pull/groom.toml").as_posix()
    shot.write_text(
        f'name = "s"\ngroom = "{groom}"\nframes = [1, 3]\nsettle = false\n'
        'quality = { base = "draft", max_substeps = 1, tolerance = 1e-6 }\n'
    )
    report = tmp_path / "s.json"
    result = invoke("bake", shot, "-o", tmp_path / "s.usdc", "--report", report)
    assert result.exit_code == 0, result.stderr
    told = json.loads(report.read_text())
    (found,) = told["worst_substeps"]
    assert found["error"] == pytest.approx(told["worst_step_error"])
    assert found["frame"] in (2, 3)
    assert 1 <= found["substeps"] <= told["substeps_over_tolerance"]
    assert found["tolerance"] == 1e-6 < found["error"]
    assert told["substep_limits"] == {"max_substeps": 1}
    assert f"{found['feather']} at frame {found['frame']:g}" in result.stderr


def test_check_tells_how_far_it_is(tmp_path):
    output = tmp_path / "p.usdc"
    assert invoke("bake", PULL, "-o", output, "--frames", "1-2").exit_code == 0
    result = invoke("check", output, "--progress", "json")
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
    assert {line["phase"] for line in lines} == {"checking", "judging"}
    assert lines[-1]["done"] == lines[-1]["total"] > 0


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(0.2, "1 s"), (44, "44 s"), (61, "a minute"), (150, "2 min"), (9000, "2.5 h")],
)
def test_times_for_people(seconds, told):
    assert about(seconds) == f"about {told}"


def test_stats_write_large_numbers_out(monkeypatch):
    groom = pipeline.stats(PULL.parent / "groom.toml")
    large = dict.fromkeys(
        ("seconds_of_a_feather_and_frame", "wall_seconds", "trial_seconds", "processor_seconds",
         "compiling_seconds", "memory_bytes", "bytes_of_the_cache"), 1234567890.0,
    )  # fmt: skip
    counts = dict.fromkeys(("frames", "unknowns", "tried_feathers", "tried_frames", "jobs"), 7)
    bake = large | counts | {"levels": {"full": 1}, "cores": 0.5, "seconds": {"settling": 810.4}}
    bake |= {"low": large, "high": large}
    monkeypatch.setattr(pipeline, "stats", lambda *_, **__: groom | {"bake": bake})
    told = invoke("stats", PULL).stdout
    assert "settling 810;" in told
    assert "about 1234567890 s (1234567890 to 1234567890) with 7 jobs" in told
    assert "e+" not in told


@pytest.mark.parametrize("command", ["check", "stats"])
def test_one_thing_is_written_to_stdout(command):
    result = invoke(command, PULL, "--progress", "openjd", "--json")
    assert result.exit_code == 2
    assert "--json and --progress openjd" in result.stderr
    assert result.stdout == ""


@pytest.mark.slow
@pytest.mark.parametrize("sample", ["breeze", "swan_wing", "flapping_bird"])
def test_stats_tell_the_processor_time_of_a_bake_whatever_else_runs(sample, tmp_path):
    shot, report = PULL.parents[1] / sample / "shot.toml", tmp_path / "report.json"
    output = ["-o", tmp_path / "out.usdc", "--report", report]
    told = [sys.executable, "-m", "featherfx", "stats", shot, "--json", "--jobs", "2"]
    bake = [sys.executable, "-m", "featherfx", "bake", shot, "--jobs", "2", *output]
    subprocess.run([*bake, "--frames", "1-1"], check=True)  # what has to be compiled
    said = subprocess.run(told, check=True, capture_output=True, text=True).stdout
    subprocess.run([*bake, "--overwrite"], check=True)
    taken = json.loads(report.read_text())["processor_seconds"]
    assert json.loads(said)["bake"]["processor_seconds"] == pytest.approx(taken, rel=0.3)


@pytest.mark.parametrize("layout", ["", pytest.param("[layout]\n", marks=pytest.mark.nightly)])
def test_feathers_in_their_skin_are_told_with_the_layout_that_they_lack(tmp_path, layout):
    shot = write_patch(tmp_path, 12, 1)
    groom = shot.with_name("groom.toml")
    text = groom.read_text().replace("[layout]\n", layout)
    groom.write_text(text.replace("[[region]]\n", "[[region]]\ntilt = -25\n"))
    shot.write_text(ON_SKIN)
    stage = Usd.Stage.Open(str(shot.with_name("body.usda")))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/skin")).GetPointsAttr()
    rest = np.array(points.Get())
    for frame in (1, 2):
        points.Set(
            Vt.Vec3fArray.FromNumpy((rest * (1.0, 1.0, 0.99 + 0.01 * frame)).astype(np.float32)),
            frame,
        )
    stage.Save()
    report = tmp_path / "patch.json"
    told = invoke("bake", shot, "-o", tmp_path / "patch.usdc", "--report", report)
    assert told.exit_code == 0
    assert json.loads(report.read_text())["skin_depth"]["unlaid"] == (0 if layout else 12)
    if not layout:
        assert "vanes in the skin" in told.stderr
    assert ("Give the groom a [layout]" in told.stderr) == (not layout)
