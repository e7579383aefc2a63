"""Prints what compiling costs in a first bake, in seconds of processor time, by entry.

python docs/measure_compiling.py [samples/swan_wing/shot.toml]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

SAMPLE = Path(__file__).resolve().parents[1] / "samples" / "swan_wing" / "shot.toml"


def measured(shot: Path) -> tuple[float, list[tuple[str, float, float]]]:
    """Seconds in all, and per entry: its name, seconds of types and lowering, seconds of LLVM."""
    from numba.core.codegen import JITCodeLibrary

    from featherfx.jit.compiled import Kernel
    from featherfx.shot.read.read import read_shot
    from featherfx.shot.simulate import simulate

    entries: list[tuple[str, float, float]] = []
    stack: list[list[float]] = []
    compile_entry, finalize = Kernel.compile, JITCodeLibrary.finalize

    def compile_timed(self: Any, signature: Any) -> Any:
        begin = time.process_time()
        # of this entry: LLVM's seconds, and those of entries compiled meanwhile
        stack.append([0.0, 0.0])
        code = compile_entry(self, signature)
        passed, (llvm, inner) = time.process_time() - begin, stack.pop()
        if stack:
            stack[-1][1] += passed
        entries.append((self.py_func.__name__, passed - llvm - inner, llvm))
        return code

    def finalize_timed(self: Any) -> None:
        begin = time.process_time()
        finalize(self)
        if stack:
            stack[-1][0] += time.process_time() - begin

    Kernel.compile, JITCodeLibrary.finalize = compile_timed, finalize_timed
    begin = time.process_time()
    for _ in simulate(read_shot(shot), jobs=1):
        pass
    return time.process_time() - begin, entries


def main() -> None:
    shot = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE
    with tempfile.TemporaryDirectory() as folder:
        os.environ["FEATHERFX_CACHE"] = folder
        total, entries = measured(shot)
    print(f"{'entry':24} types, lowering    LLVM")
    for name, front, llvm in sorted(entries, key=lambda each: -each[1] - each[2]):
        if front + llvm > 0.1:
            print(f"{name:24} {front:10.2f} {llvm:12.2f}")
    front, llvm = (sum(each[k] for each in entries) for k in (1, 2))
    print(f"{'all':24} {front:10.2f} {llvm:12.2f}\nthe whole simulation {total:.1f} s")


if __name__ == "__main__":
    main()
