"""Prints what compiling costs in a first bake, in seconds of processor time, by entry.

python docs/measure_compiling.py [samples/swan_wing/shot.toml]

With --write instead of a shot: what kernels of a layout, a bake and a bake with contact cost, into
featherfx/jit/seconds.json, which progress of compiling goes by.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SAMPLES = Path(__file__).resolve().parents[1] / "samples"
SAMPLE = SAMPLES / "swan_wing" / "shot.toml"


def simulated(shot: Path) -> None:
    from featherfx.shot.read.read import read_shot
    from featherfx.shot.simulate import simulate

    for _ in simulate(read_shot(shot), jobs=1):
        pass


def laid_out() -> None:
    from featherfx.api import read_groom

    read_groom(SAMPLES / "pigeon" / "groom.toml")


def baked(sample: str) -> None:
    from featherfx.baking.pipeline import bake

    with tempfile.TemporaryDirectory() as folder:
        shot = SAMPLES / sample / "shot.toml"
        bake(shot, Path(folder) / "out.usdc", frames=(1, 2), quality="draft", jobs=2)


WORKS: dict[str, Callable[[], None]] = {
    "layout": laid_out,
    "bake": lambda: baked("swan_wing"),
    "contact": lambda: baked("flapping_bird"),
}


def measured(work: Callable[[], None]) -> tuple[float, list[tuple[str, float, float]]]:
    """Seconds in all, and per entry: its name, seconds of types and lowering, seconds of LLVM."""
    from numba.core.codegen import JITCodeLibrary

    from featherfx.jit import inner
    from featherfx.jit.compile_progress import name_of

    entries: list[tuple[str, float, float]] = []
    own = threading.local()  # threads of a bake wait for each other's compiling
    compile_entry, finalize = inner.compile_entry, JITCodeLibrary.finalize

    def compile_timed(kernel: Any, types: Any) -> Any:
        stack, begin = vars(own).setdefault("stack", []), time.thread_time()
        # of this entry: LLVM's seconds, and those of entries compiled meanwhile
        stack.append([0.0, 0.0])
        code = compile_entry(kernel, types)
        passed, (llvm, nested) = time.thread_time() - begin, stack.pop()
        if stack:
            stack[-1][1] += passed
        entries.append((name_of(kernel.py_func), passed - llvm - nested, llvm))
        return code

    def finalize_timed(self: Any) -> None:
        stack, begin = vars(own).get("stack"), time.thread_time()
        before = stack[-1][1] if stack else 0.0
        finalize(self)
        if stack:
            # loading code that calls others has these compiled first
            stack[-1][0] += time.thread_time() - begin - (stack[-1][1] - before)

    inner.compile_entry, JITCodeLibrary.finalize = compile_timed, finalize_timed
    begin = time.process_time()
    work()
    return time.process_time() - begin, entries


def write() -> None:
    """Measure every work in a process of its own, that has no machine code yet."""
    found = {}
    for name in WORKS:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, __file__, "--one", name]
            environment = os.environ | {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
            done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
        seconds: dict[str, float] = {}
        for entry, front, llvm in json.loads(done.stdout):
            count = sum(each.partition("#")[0] == entry for each in seconds)
            seconds[f"{entry}#{count + 1}" if count else entry] = round(front + llvm, 2)
        found[name] = seconds
    from featherfx.jit.compile_progress import SECONDS

    SECONDS.write_text(json.dumps(found, indent=1) + "\n")


def main() -> None:
    if sys.argv[1:] == ["--write"]:
        write()
        return
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measured(WORKS[sys.argv[2]])[1]))
        return
    shot = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
        total, entries = measured(lambda: simulated(shot))
    print(f"{'entry':24} types, lowering    LLVM")
    for name, front, llvm in sorted(entries, key=lambda each: -each[1] - each[2]):
        if front + llvm > 0.1:
            print(f"{name.rpartition('.')[2]:24} {front:10.2f} {llvm:12.2f}")
    front, llvm = (sum(each[k] for each in entries) for k in (1, 2))
    print(f"{'all':24} {front:10.2f} {llvm:12.2f}\nthe whole simulation {total:.1f} s")


if __name__ == "__main__":
    main()
