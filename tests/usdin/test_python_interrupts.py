"""Calls of the Python interface end by Ctrl-C without leftovers."""

import signal
import subprocess
import sys

import pytest
from places import SAMPLES

STOPPED = """
import sys, threading, time
import featherfx as ffx

def say(done, total):
    print("on", flush=True)
    time.sleep(0.05)

kind, source = sys.argv[1:]
try:
    if kind == "simulate":
        for frame in ffx.simulate(source):
            say(frame.number, 0)
    else:
        getattr(ffx, kind)(source, *(["out.usdc"] if kind == "bake" else []), progress=say)
except KeyboardInterrupt:
    print(*(each.name for each in threading.enumerate() if not each.daemon))
"""


@pytest.mark.parametrize(
    ("call", "source"),
    [
        ("bake", "swan_wing/shot.toml"),
        ("simulate", "swan_wing/shot.toml"),
        ("check", "first_bird/groom.toml"),
        ("stats", "first_bird/groom.toml"),
    ],
)
def test_a_call_ends_by_an_interrupt_without_traces(tmp_path, call, source):
    command = [sys.executable, "-c", STOPPED, call, SAMPLES / source]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "on\n"
        process.send_signal(signal.SIGINT)
        output = process.communicate(timeout=60)[0]
    assert process.returncode == 0
    assert output.splitlines()[-1] == "MainThread"
    assert not (tmp_path / "out.usdc").exists()
