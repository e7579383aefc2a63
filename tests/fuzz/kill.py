"""Commands disturbed at seeded times and run again, compared byte by byte with undisturbed ones.

They are killed; or, where there is a C compiler, writes below their folder fail from some one on,
as on a full or broken disk, or clocks jump (faults.c). Bakes go on with --resume, in three layouts;
the others begin again. Commands are forks of a process that has loaded the kernels.
"""

from __future__ import annotations

import errno
import importlib
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

from featherfx.api import read_quality, read_shot
from featherfx.shot.loop.simulate import simulate

from .cases import Failure, Found, nothing

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
SHOT = SAMPLES / "feather_pull/shot.toml"
WING = SAMPLES / "swan_wing"
MODULES = (
    "featherfx.baking.bake",
    "featherfx.baking.frame_loop",
    "featherfx.cli.bake",
    "featherfx.usd.write.cache_writer",
    "pxr.UsdGeom",
)
MAX_KILLS = 5  # of one command before it is left in peace
SECONDS = 240  # beyond which a command hangs
# of a disk; writes of a command until the first that fails, at most; s by which a clock jumps
ERRORS, MAX_WRITES, JUMPS = (errno.EIO, errno.ENOSPC), 60, (-86400, 3600)
KILL, FAULTS = "kill", ("error", "jump")


class Job(NamedTuple):
    """A command in a folder that holds the inputs. again: options of the second run."""

    arguments: tuple[str, ...]
    again: tuple[str, ...] = ("--overwrite",)


BAKE = ("bake", str(SHOT), "-o", "o.usdc", "--quality", "draft", "--frames", "1-8", "--chunk", "2")
DASK = ("--engine", "dask", "--workers", "1", "--resume")
JOBS = {
    "clips": Job((*BAKE, "--jobs", "1", "--resume", "--layout", "clips"), ()),
    "dask": Job((*BAKE, *DASK), ()),
    "export": Job(("export", "in.usdc", "-o", "o.usda")),
    "flat": Job((*BAKE, "--jobs", "1", "--resume", "--layout", "flat"), ()),
    "join": Job(("join", "share.usdc", "--shares", "2")),
    "payload": Job((*BAKE, "--jobs", "1", "--resume", "--layout", "payload"), ()),
    "retime": Job(("retime", "in.usdc", "-o", "o.usdc", "--speed", "0.25")),
    "groom": Job(("groom", str(WING / "groom.toml"), "-o", "o.usdc")),
    "meshes": Job(("export", "in.usdc", "-o", "o.ply")),
    "preview": Job(("preview", "in.usdc", "-o", "o.png", "--frame", "3", "--size", "64x48")),
}


def run(cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each case by name.

    done: a command that was killed and run again leaves the same files, byte by byte, and no other.
    killed: commands that a kill hit; failed: that ended with a message as the disk did. differs,
    stray, refused, hang, traceback: what must not be. keep: takes the folders of such cases.
    """
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        inputs = whole / "inputs"
        load_kernels()
        make_inputs(inputs)
        mixed = (KILL, *FAULTS) if build_faults(whole / "faults.so") else (KILL,)
        expected: dict[str, tuple[float, dict[str, bytes]]] = {}
        for number in cases:
            result = nothing()
            chance = random.Random(f"{seed} {number}")
            job = list(JOBS)[number % len(JOBS)]
            if job not in expected:
                expected[job] = undisturbed(whole / job, inputs, JOBS[job])
            seconds, files = expected[job]
            # of one name, since caches tell their own
            folder = whole / job
            shutil.copytree(inputs, folder)
            end, ways = "", chance.choice(((KILL,), mixed))
            for time_over in range(chance.randint(1, MAX_KILLS)):
                again, way = bool(time_over), chance.choice(ways)
                if way == KILL:
                    result.outcomes["killed"] += is_killed(
                        folder, JOBS[job], again, chance, seconds
                    )
                    continue
                fault = {"LD_PRELOAD": str(whole / "faults.so"), "FAULT_FOLDER": str(folder)}
                if way == "jump":
                    fault["FAULT_JUMP"] = str(chance.choice(JUMPS))
                else:
                    fault["FAULT_ERRNO"] = str(chance.choice(ERRORS))
                    fault["FAULT_AFTER"] = str(chance.randint(1, MAX_WRITES))
                told = run_faulty(folder, JOBS[job], again, fault)
                end = end or ("traceback" if "Traceback" in told else "")
                result.outcomes["failed"] += bool(told)
            end = end or compare_second_run(folder, JOBS[job], files)
            result.outcomes[end] += 1
            if end != "done":
                result.failures.append(Failure(number, f"{job}: {end}"))
                if keep is not None:
                    shutil.copytree(folder, keep / f"{seed}_{number}", dirs_exist_ok=True)
            shutil.rmtree(folder)
            result.through.append(number)
            yield result


def make_inputs(folder: Path) -> None:
    """Write a cache, and the shares of another."""
    folder.mkdir()
    bake = ("--quality", "draft", "--frames", "1-6", "--jobs", "1")
    assert end_of(start(folder, ("bake", str(SHOT), "-o", "in.usdc", *bake))) == 0
    for share in ("1/2", "2/2"):
        own = ("bake", str(WING / "shot.toml"), "-o", "share.usdc", "--feathers", share, *bake)
        assert end_of(start(folder, own)) == 0


def load_kernels() -> None:
    """Import modules and simulate three frames, without a stage, which would start threads."""
    for name in MODULES:
        importlib.import_module(name)
    shot = replace(read_shot(SHOT), quality=read_quality("draft"))
    list(simulate(shot, 1, (1, 3)))


def start(folder: Path, arguments: Sequence[str]) -> BaseProcess:
    """Start a command in a folder."""
    process = multiprocessing.get_context("fork").Process(target=work, args=(folder, arguments))
    process.start()
    return process


def work(folder: Path, arguments: Sequence[str]) -> None:
    """Run a command in a folder and end; a cluster needs a process that is no fork."""
    os.chdir(folder)
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(silent, stream)
    if "dask" in arguments:
        os.execv(sys.executable, [sys.executable, "-m", "featherfx", *arguments])
    from featherfx.cli.main import main

    main.main(list(arguments), "featherfx")


def end_of(process: BaseProcess, seconds: float | None = None) -> int | None:
    """Exit code of a process when it ends, or what it is after some s: None while it runs."""
    process.join(seconds)
    return process.exitcode


def build_faults(target: Path) -> bool:
    """Compile the library of faults; whether there is a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        print("no C compiler: commands are killed, but no disk fails", flush=True)
        return False
    source = str(Path(__file__).with_name("faults.c"))
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", source, "-o", target, "-ldl"], check=True)
    return True


def run_faulty(folder: Path, job: Job, is_again: bool, fault: dict[str, str]) -> str:
    """Run a command on a disk that fails, or with clocks that jump; what it says where it fails."""
    command = [sys.executable, "-m", "featherfx", *job.arguments, *(job.again if is_again else ())]
    how = {"cwd": folder, "env": os.environ | fault, "timeout": SECONDS, "capture_output": True}
    done = subprocess.run(command, text=True, check=False, **how)
    if done.returncode and "featherfx: " not in done.stderr:
        return f"Traceback? {done.returncode} {done.stderr}"
    return done.stderr if done.returncode else ""


def undisturbed(folder: Path, inputs: Path, job: Job) -> tuple[float, dict[str, bytes]]:
    """Seconds of a command, and the files that it leaves; run twice, since the first compiles."""
    for _ in range(2):
        shutil.copytree(inputs, folder)
        begin = time.monotonic()
        assert end_of(start(folder, job.arguments)) == 0, job
        seconds, files = time.monotonic() - begin, tree(folder)
        shutil.rmtree(folder)
    return seconds, files


def is_killed(
    folder: Path, job: Job, is_again: bool, chance: random.Random, seconds: float
) -> bool:
    """Run a command and kill it at any time, more often in its second half."""
    process = start(folder, job.arguments + (job.again if is_again else ()))
    part = chance.choice([chance.uniform(0.0, 1.0), chance.uniform(0.5, 1.0)])
    if end_of(process, seconds * part) is None:
        process.kill()
    return end_of(process) == -signal.SIGKILL


def compare_second_run(folder: Path, job: Job, expected: dict[str, bytes]) -> str:
    """Run a command to its end and compare what it leaves."""
    process = start(folder, job.arguments + job.again)
    code = end_of(process, SECONDS)
    if code is None:
        process.kill()
        process.join()
        return "hang"
    if code:
        return "refused"
    found = tree(folder)
    if found.keys() != expected.keys():
        print(sorted(found.keys() ^ expected.keys()), flush=True)
        return "stray"
    differing = [name for name in expected if found[name] != expected[name]]
    if differing:
        print("differing:", differing, flush=True)
    return "differs" if differing else "done"


def tree(folder: Path) -> dict[str, bytes]:
    """Contents of all files by their names."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}
