"""Failures become one message and an exit code; wrong usage is told with help."""

import contextlib
import errno
import json
import os
import re
import resource
import signal
import subprocess
import sys
from dataclasses import fields

import click
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Usd

from featherfx.baking import pipeline
from featherfx.baking.options import BakeOptions, GroomOptions
from featherfx.cli.main import main
from featherfx.errors import InputError, Problem, SimulationError
from featherfx.limits import MIN_ADDRESS_SPACE

SHOT = SAMPLES / "feather_pull/shot.toml"
GROOM = SHOT.with_name("groom.toml")
NO_SPACE = OSError(errno.ENOSPC, "No space left on device", "wing.usdc")
FAILURES = [
    (
        InputError(Problem("a.toml", "row[0].count", "0 is out of range"), Problem("b", "", "bad")),
        "featherfx: a.toml: row[0].count: 0 is out of range.\nfeatherfx: b: bad.\n",
    ),
    (
        SimulationError("primary_3", 0.25, "no convergence"),
        "featherfx: feather primary_3 at t = 0.25 s: no convergence.\n",
    ),
    (KeyboardInterrupt(), "featherfx: interrupted\n"),
    (NO_SPACE, "featherfx: wing.usdc: No space left on device\n"),
]


def failing(monkeypatch, failure):
    def bake(*arguments, **options):
        raise failure

    monkeypatch.setattr(pipeline, "bake", bake)


@pytest.mark.parametrize(("failure", "message"), FAILURES)
def test_a_failure_is_one_message_and_exit_code_one(monkeypatch, failure, message):
    failing(monkeypatch, failure)
    result = invoke("bake", "shot.toml")
    assert result.exit_code == 1
    assert result.stderr == message
    assert result.stdout == ""


@pytest.mark.parametrize(("failure", "message"), FAILURES)
def test_verbose_adds_the_traceback(monkeypatch, failure, message):
    failing(monkeypatch, failure)
    result = invoke("bake", "shot.toml", "--verbose")
    assert result.exit_code == 1
    assert result.stderr.startswith("Traceback")
    assert result.stderr.endswith(message)


def test_a_fault_of_the_program_is_not_hidden(monkeypatch):
    failing(monkeypatch, ZeroDivisionError("fault"))
    assert isinstance(invoke("bake", "shot.toml").exception, ZeroDivisionError)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["bake"], "Missing argument 'SHOT...'"),
        (["bake", "s.toml", "--frames", "5-1"], "ends before it starts"),
        (["bake", "s.toml", "--frames", "a-b"], "such as 1-24"),
        (["bake", "s.toml", "--jobs", "0"], "1<=x<=1024"),
        (["bake", "s.toml", "--jobs", "100000"], "1<=x<=1024"),
        (["bake", "s.toml", "--jobs", "1" + "0" * 30], "1<=x<=1024"),
        (["stats", "s.toml", "--jobs", "100000"], "1<=x<=1024"),
        (["bake", "s.toml", "--render-rows", "100000000"], "3<=x<=5000"),
        (["bake", "s.toml", "--render-columns", "100000000"], "1<=x<=500"),
        (["groom", "g.toml", "-o", "g.usda", "--barbs", "1000000"], "1<=x<=10000"),
        (["bake", "s.toml", "--subframes", "1000000000"], "1<=x<=1000"),
        (["bake", "s.toml", "--chunk", "1" + "0" * 30], "1<=x<=1000000"),
        (["bake", "s.toml", "--plan", "100000000"], "1<=x<=10000"),
        (["bake", "s.toml", "--feathers", "1/" + "9" * 30], "at most 10000 shares"),
        (["bake", "s.toml", "--frames", "1-" + "9" * 5000], "frames lie within"),
        (["preview", "f.usd", "-o", "p.png", "--size", "9" * 5000 + "x16"], "16 to 8192 pixels"),
        (["preview", "f.usd", "-o", "p.png", "--sheet", "1000000000"], "1<=x<=400"),
        (["bake", "s.toml", "--meters-per-unit", "0"], "x>0"),
        (["bake", "s.toml", "--up-axis", "X"], "is not one of"),
        (["bake", "s.toml", "--layout", "clip"], "is not one of"),
        (["bake", "s.toml", "--diagnostics", "stress"], "'stress' is not one of strain, energy"),
        (["bake", "s.toml", "--presets", "no/such/folder"], "does not exist"),
        (["bake", "s.toml", "--presets", "/dev/null"], "is not a folder"),
        (["groom", "g.toml"], "Missing option '-o'"),
        (["check"], "Missing argument 'FILE...'"),
        (["preview", "f.usd", "-o", "p.png", "--size", "big"], "such as 1280x720"),
        (["preview", "f.usd", "-o", "p.png", "--sheet", "3", "--frame", "1"], "do not agree"),
        (["presets", "show"], "Missing argument 'NAME'"),
        (["fly"], "No such command 'fly'"),
        (["bench", "--promise", "1", "--only", "gust"], "--only goes with --skips"),
    ],
)
def test_wrong_usage_is_exit_code_two(arguments, told):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert told in result.stderr


def test_a_file_without_permission_is_a_problem_like_any_other(tmp_path, monkeypatch):
    file = tmp_path / "skin.usda"
    file.write_text("#usda 1.0\n")
    monkeypatch.setattr(os, "access", lambda *_: False)
    result = invoke("check", str(file))
    assert result.exit_code == 1
    assert "may not be read" in result.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["bake", "samples/feather_pull/shot.toml", "-o"],
        ["bake", "samples/feather_pull/shot.toml", "--plan", "1", "-o"],
        ["groom", "samples/feather_pull/groom.toml", "-o"],
        ["join", "--shares", "2"],
    ],
)
@pytest.mark.parametrize("output", [".", "/", "a\nb.usda"])
def test_an_output_needs_a_name(arguments, output):
    result = invoke(*arguments, output)
    assert result.exit_code == 1
    assert (
        result.stderr
        == "featherfx: {}: is no name of a file. Give one with a suffix such as .usdc.\n".format(
            output.replace("\n", "\\n")
        )
    )


def test_meshes_that_fit_into_no_memory_are_refused(monkeypatch):
    monkeypatch.setenv("FEATHERFX_MEMORY", "1")
    for command, file in (("bake", "shot.toml"), ("groom", "groom.toml")):
        path = f"samples/feather_pull/{file}"
        size = ["--render-rows", "5000", "--render-columns", "500"]
        result = invoke(command, path, "-o", "no.usdc", *size)
        assert result.exit_code == 1
        assert result.stderr == (
            f"featherfx: {path}: 1 feathers of 5000 rows and 500 columns a side would need about "
            "12.3 GB of memory, more than the 1 GB that FEATHERFX_MEMORY allows.\n"
        )


def test_options_reach_the_bake(monkeypatch):
    seen = {}

    def bake(shot, **options):
        seen.update(options, shot=str(shot))
        options["on_frame"](0, 2)
        options["on_frame"](2, 2)
        return {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}

    monkeypatch.setattr(pipeline, "bake", bake)
    result = invoke("bake", "s.toml", "--frames", "-3-12", "--jobs", "2", "--up-axis", "y")
    assert result.exit_code == 0, result.stderr
    assert (seen["shot"], seen["frames"], seen["jobs"]) == ("s.toml", (-3, 12), 2)
    assert (seen["up_axis"], seen["meters_per_unit"], seen["layout"]) == ("Y", None, "auto")
    assert seen["output"] is None
    assert (
        result.stderr == "frames: 0 of 2\nframes: 2 of 2\np.usdc: 3 feathers, 2 frames in 1.2 s\n"
    )


@pytest.mark.parametrize("command", [name for name in main.commands if name != "presets"])
def test_help_of_every_command_shows_examples(command):
    result = invoke(command, "--help")
    assert result.exit_code == 0
    assert f"  featherfx {command} " in result.stdout.partition("Examples:")[2]


@pytest.mark.parametrize(("command", "options"), [("bake", BakeOptions), ("groom", GroomOptions)])
def test_every_option_of_a_function_is_one_of_the_command(command, options):
    names = {param.name for param in main.commands[command].params}
    assert {each.name for each in fields(options)} <= names


def test_the_many_options_of_a_bake_stand_under_titles():
    text = invoke("bake", "--help").stdout
    for option in main.commands["bake"].params:
        if isinstance(option, click.Option):
            assert len(re.findall(rf"^  (-o, )?{option.opts[-1]} ", text, re.M)) == 1, option.name
    order = ["Options:", "--frames", "What is simulated:", "--quality", "What is written:"]
    order += ["--group", "Farms:", "--plan", "Messages:", "--verbose", "Examples:"]
    places = [text.index(f"  {each}" if each.startswith("-") else each) for each in order]
    assert places == sorted(places)


def test_help_answers_at_once():
    code = [sys.executable, "-m", "featherfx", "--help"]
    before = os.times()
    done = subprocess.run(code, capture_output=True, text=True, check=True)
    assert "bake" in done.stdout
    after = os.times()
    # a third of a second; this bound only catches a heavy import
    spent = after.children_user + after.children_system
    assert spent - before.children_user - before.children_system < 1.5


def test_a_command_is_over_when_its_report_says_so(tmp_path):
    """Nearly all of its processor time is in the report; a fifth was for taking apart modules."""
    report = tmp_path / "report.json"
    shown = ["-o", str(tmp_path / "pull.usdc"), "--frames", "1-2", "--overwrite"]
    options = [*shown, "--jobs", "1", "--report", str(report)]
    for _ in range(2):  # the first may have helpers compile
        before = os.times()
        bake = [sys.executable, "-m", "featherfx", "bake", str(SHOT), *options]
        subprocess.run(bake, check=True, stderr=subprocess.DEVNULL)
        after = os.times()
    spent = after.children_user + after.children_system
    spent -= before.children_user + before.children_system
    assert spent - json.loads(report.read_text())["processor_seconds"] < 0.1 * spent


LEAVE = """
import atexit, threading, time
from featherfx.cli.program import leave
print(100_000 * "x")
atexit.register(print, "at exit")
{}
leave(3)
print("Python ends")
"""
WORKING = "threading.Thread(target=lambda: time.sleep(0.2) or print('thread')).start()"


@pytest.mark.parametrize(
    ("before", "code", "said"),
    [
        ("", 3, ["at exit"]),
        (WORKING, 0, ["Python ends", "thread", "at exit"]),
        ("__import__('sys').setprofile(lambda *_: None)", 0, ["Python ends", "at exit"]),
    ],
)
def test_what_waits_for_the_end_of_a_command_is_not_cut_off(before, code, said):
    script = [sys.executable, "-c", LEAVE.format(before)]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == code
    lines = done.stdout.splitlines()
    assert [len(lines[0]), *lines[1:]] == [100_000, *said]


def test_an_interrupt_that_a_library_swallows_is_not_lost(monkeypatch):
    def bake(shot, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        options["on_frame"](0, 2)
        return {"output": "p.usdc", "feathers": 3, "frames": 2, "wall_seconds": 1.25}

    monkeypatch.setattr(pipeline, "bake", bake)
    result = invoke("bake", "s.toml")
    assert (result.exit_code, result.stderr) == (1, "featherfx: interrupted\n")


@pytest.mark.skipif(os.name == "nt", reason="needs a shell of Unix")
@pytest.mark.parametrize(
    "stream", [pytest.param("2>/dev/full", marks=pytest.mark.slow), "<&- >&- 2>&-"]
)
def test_a_stderr_that_takes_nothing_ends_no_work(tmp_path, stream):
    output = tmp_path / "feathers.usdc"
    code = tmp_path / "code"
    command = f"({sys.executable} -m featherfx groom {GROOM} -o {output}; echo $? >{code}) {stream}"
    subprocess.run(["sh", "-c", command], check=False)
    assert code.read_text() == "0\n"
    assert Usd.Stage.Open(str(output)).GetDefaultPrim()


def run_featherfx(*arguments, variables=None, address_space=None):
    """Run a command in a process of its own, with variables and bytes of address space."""

    def limit():
        if address_space is not None:
            resource.setrlimit(resource.RLIMIT_AS, (address_space, address_space))

    return subprocess.run(
        [sys.executable, "-m", "featherfx", *map(str, arguments)],
        env=os.environ | (variables or {}),
        capture_output=True,
        encoding="utf-8",
        check=False,
        preexec_fn=limit,
    )


def test_an_environment_that_cannot_work_is_one_message(tmp_path):
    variables = {"NUMBA_DISABLE_JIT": "1"}
    done = run_featherfx("bake", SHOT, "-o", tmp_path / "a.usdc", variables=variables)
    assert done.returncode == 1
    assert done.stderr.startswith("featherfx: ")
    assert "NUMBA_DISABLE_JIT: is set, but" in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("variables", [{"PYTHONUTF8": "0"}, {"PYTHONIOENCODING": "ascii"}])
def test_names_are_utf8_in_every_locale(tmp_path, variables):
    cache = tmp_path / "h\u00e9ron.usda"
    assert invoke("groom", GROOM, "-o", cache, "--quality", "draft").exit_code == 0
    variables = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"} | variables
    done = run_featherfx("inspect", cache, variables=variables)
    assert done.returncode == 0, done.stderr
    assert "h\u00e9ron.usda" in done.stderr
    assert "ron.usda" in done.stdout.splitlines()[0]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limit")
def test_a_small_address_space_is_told_before_the_work(tmp_path):
    bake = ("bake", SHOT, "-o", tmp_path / "a.usdc", "--frames", "1-2", "--quality", "draft")
    done = run_featherfx(*bake, address_space=900_000_000)
    assert done.returncode == 1
    assert "(ulimit -v): allows 900 MB, but at least 1.25 GB are needed" in done.stderr
    assert list(tmp_path.iterdir()) == []
    assert run_featherfx("presets", "list", address_space=900_000_000).returncode == 0
    done = run_featherfx(*bake, address_space=int(MIN_ADDRESS_SPACE))
    assert done.returncode == 0, done.stderr


def test_problems_name_the_line_and_the_entry(tmp_path):
    groom = tmp_path / "groom.toml"
    groom.write_text(
        'name = "wing"\nlayot = 1\n\n[[row]]\nid = "first"\nkind = "covert"\n\n'
        '[[row]]  # the long ones\nid = "primary"\nkind = "covert"\ncount = 0\n'
    )
    told = invoke("check", groom).stdout.splitlines()
    by_key = {line.split(": ")[1]: line for line in told}
    assert by_key["row[1].count ('primary')"].startswith(f"{groom}:11: ")
    assert by_key["row[0].count ('first')"].startswith(f"{groom}:4: ")
    assert by_key["layot"].startswith(f"{groom}:2: ")
    done = invoke("groom", groom, "-o", tmp_path / "out.usda")
    assert "featherfx: " + by_key["row[1].count ('primary')"] in done.stderr.splitlines()
