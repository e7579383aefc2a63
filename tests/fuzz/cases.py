"""Runs commands on damaged inputs, each case in a process of its own, and counts what happens."""

from __future__ import annotations

import importlib
import os
import resource
import select
import shutil
import signal
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

SECONDS = 60  # of processor time, beyond which a case hangs unless its kind has another bound
# s on the clock in which a case that takes no more of the processor hangs
PATIENCE, IDLE = 600.0, 0.1
MEMORY = 4 << 30  # bytes of a case
FINE = ("done", "refused")


@dataclass(frozen=True)
class Command:
    """Arguments of featherfx, with paths within the case's folder, and the files it may write."""

    arguments: tuple[str, ...]
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kind:
    """One kind of damage.

    prepare: makes sound inputs in a folder. damage: changes the copies of one case in the folder
    that it is given, and says how and which commands to run there. modules: imported once. judge:
    given the folder and what a command said that is done; names what must not be. warm: loads
    kernels for all cases, in an empty folder and without a thread. seconds: of processor time of a
    case.
    """

    prepare: Callable[[Path], None]
    damage: Callable[[np.random.Generator, int, Path], tuple[str, Sequence[Command]]]
    modules: tuple[str, ...] = ()
    judge: Callable[[Path, str], str] = lambda folder, said: ""
    warm: Callable[[Path], None] = lambda folder: None
    seconds: int = SECONDS


class Failure(NamedTuple):
    """A case that did not end as it should, by its number, and what it said."""

    case: int
    said: str


class Found(NamedTuple):
    """What became of some cases: outcomes by name, those that are not fine, figures of each where
    a kind has them, and numbers of the cases that are through."""

    outcomes: Counter[str]
    failures: list[Failure]
    scenes: list[dict[str, Any]]
    through: list[int]


def nothing() -> Found:
    """What is found before the first case."""
    return Found(Counter(), [], [], [])


def run(kind: Kind, cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each case's commands.

    done: exit code 0. refused: 1 with a message. traceback, crash (a signal), hang, memory,
    silent (1 without a message), judged (what the kind names is wrong with the output), stray (a
    file that no output was to be), unfit (the case itself could not be made).
    keep: folder that takes the inputs of cases that are not fine.
    """
    for name in ("featherfx.cli.main", *kind.modules):
        importlib.import_module(name)
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        sound = whole / "sound"
        sound.mkdir()
        # in a process of its own, so that this one never has the threads of USD
        child(whole / "log", lambda _: kind.prepare(sound))
        if (whole / "log").read_text():
            raise RuntimeError((whole / "log").read_text())
        kind.warm(whole)
        for number in cases:
            result = nothing()
            folder = whole / f"case{number}"
            shutil.copytree(sound, folder)
            log = whole / f"case{number}.log"

            def one(log: int, number: int = number, folder: Path = folder) -> None:
                os.chdir(folder)
                random = np.random.default_rng([seed, number])
                text, commands = kind.damage(random, number, folder)
                os.write(log, f"case {text}\n".encode())
                for command in commands:
                    os.write(log, f"start {' '.join(command.arguments)}\n".encode())
                    _execute(command, folder, log, kind.judge)

            end = child(log, one, kind.seconds)
            ended, said = _outcomes(log.read_text(errors="replace"), end)
            result.outcomes.update(ended)
            if set(ended) - set(FINE):
                result.failures.append(Failure(number, said))
                if keep is not None:
                    pipes = shutil.ignore_patterns("pipe")
                    shutil.copytree(
                        folder, keep / f"{seed}_{number}", ignore=pipes, dirs_exist_ok=True
                    )
            shutil.rmtree(folder)
            log.unlink()
            result.through.append(number)
            yield result


def child(log: Path, work: Callable[[int], None], seconds: int = SECONDS) -> int:
    """Wait status of a process that does the work, with bounds on its time and memory.

    work: is given the log, open for writing.
    """
    process = os.fork()
    if process:
        try:
            return _end_of(process)
        except KeyboardInterrupt:
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            raise
    code = 0
    target = os.open(log, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    try:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        work(target)
    except BaseException:
        os.write(target, f"unfit {traceback.format_exc()}\n".encode())
        code = 1
    os._exit(code)


def _end_of(process: int) -> int:
    """Wait status of a process, which is ended where it only waits: on a busy machine one that
    works may take long on the clock."""
    ends, spent = os.pidfd_open(process), 0.0
    with os.fdopen(ends):
        while not select.select([ends], [], [], PATIENCE)[0]:
            fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
            now = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            if now - spent < IDLE:
                os.kill(process, signal.SIGALRM)
            spent = now
    return os.waitpid(process, 0)[1]


def _execute(command: Command, folder: Path, log: int, judge: Callable[[Path, str], str]) -> None:
    """Run a command of featherfx; writes its outcome to the log. judge: as of Kind."""
    from featherfx.cli.main import main

    before = _files(folder)
    said = os.open(folder.parent / "said", os.O_CREAT | os.O_TRUNC | os.O_RDWR)
    os.dup2(said, 1)
    os.dup2(said, 2)
    try:
        code = main.main(list(command.arguments), "featherfx", standalone_mode=False)
        text = Path(folder.parent / "said").read_text(errors="replace")
        told = any(
            line.startswith("featherfx: ") and not line.startswith("featherfx: warning")
            for line in text.splitlines()
        )
        refused = told or command.arguments[0] == "check"
        outcome = "done" if not code else "refused" if refused else f"silent {text}"
        if outcome == "done" and (fault := judge(folder, text)):
            outcome = f"judged {fault}: {text}"
    except click.UsageError:
        outcome = "refused"
    except MemoryError:
        outcome = "memory"
    except BaseException:
        outcome = f"traceback {traceback.format_exc()}"
    stray = _files(folder) - before - set(command.outputs)
    if stray:
        outcome = f"stray {sorted(stray)}"
    os.write(log, f"end {outcome}\n".encode())


def _files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def _outcomes(log: str, end: int) -> tuple[list[str], str]:
    """Outcome names of the commands of a log, and the log's parts that tell of what is not fine."""
    found, told, command = [], [], ""
    for part in log.split("\n"):
        word, _, rest = part.partition(" ")
        if word == "case":
            told.append(rest)
        elif word == "start":
            command = rest
        elif word == "end":
            found.append(rest.split(" ")[0])
            if found[-1] not in FINE:
                told.append(f"{command}: {rest}")
            command = ""
        elif word == "unfit":
            found.append("unfit")
            told.append(part)
        elif told:
            told.append(part)
    if os.WIFSIGNALED(end):
        outcome, name = ended_by(end)
        found.append(outcome)
        told.append(f"{command}: {name}")
    return found, "\n".join(told).strip()


def ended_by(end: int) -> tuple[str, str]:
    """Outcome of a process that a signal ended, and the signal's name. end: its wait status."""
    name = signal.Signals(os.WTERMSIG(end)).name
    return ("hang" if name in ("SIGALRM", "SIGPROF") else "crash"), name
