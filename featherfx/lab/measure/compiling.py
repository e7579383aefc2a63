"""Processor time of compiling, by entry."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from featherfx.api import read_shot
from featherfx.jit.compile_progress import SECONDS
from featherfx.shot.loop.simulate import simulate

Entry = tuple[str, float, float]


def measure_entries(work: Callable[[], None]) -> list[Entry]:
    """Do a work, and return of each entry compiled its name, seconds of lowering and of LLVM."""
    from numba.core.codegen import JITCodeLibrary

    from featherfx.jit import compiler

    entries: list[Entry] = []
    own = threading.local()  # threads of a bake wait for each other's compiling
    compile_entry, finalize = compiler.compile_entry, JITCodeLibrary.finalize

    def compile_timed(kernel: Any, types: Any) -> Any:
        stack, begin = vars(own).setdefault("stack", []), time.thread_time()
        # of this entry: LLVM's seconds, and those of entries compiled meanwhile
        stack.append([0.0, 0.0])
        code = compile_entry(kernel, types)
        passed, (llvm, nested) = time.thread_time() - begin, stack.pop()
        if stack:
            stack[-1][1] += passed
        entries.append((kernel.name, passed - llvm - nested, llvm))
        return code

    def finalize_timed(self: Any) -> None:
        stack, begin = vars(own).get("stack"), time.thread_time()
        before = stack[-1][1] if stack else 0.0
        finalize(self)
        if stack:
            # loading code that calls others has these compiled first
            stack[-1][0] += time.thread_time() - begin - (stack[-1][1] - before)

    with (
        patch.object(compiler, "compile_entry", compile_timed),
        patch.object(JITCodeLibrary, "finalize", finalize_timed),
    ):
        work()
    return entries


def shot_entries(shot: Path) -> list[Entry]:
    """Return what simulating a shot compiles, largest first, with an empty cache."""

    def work() -> None:
        for _ in simulate(read_shot(shot), jobs=1):
            pass

    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
        return sorted(measure_entries(work), key=lambda each: -each[1] - each[2])


def write_seconds(works: Iterable[str]) -> Path:
    """Write the file that the progress of compiling goes by; each work in its own process."""
    found = {}
    for name in works:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "featherfx", "lab", "measure", "compiling"]
            environment = os.environ | {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
            done = subprocess.run(
                [*command, "--work", name], env=environment, stdout=subprocess.PIPE, check=True
            )
        seconds: dict[str, float] = {}
        for entry, front, llvm in json.loads(done.stdout):
            count = sum(each.partition("#")[0] == entry for each in seconds)
            seconds[f"{entry}#{count + 1}" if count else entry] = round(front + llvm, 2)
        found[name] = seconds
    SECONDS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return SECONDS
