"""Size of packages, processor time of compiling, and droop of scaled feathers."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from featherfx.api import read_shot
from featherfx.feather.build import build_feather
from featherfx.files.disk_cache import nothing_kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.jit.compile_workers import SECONDS
from featherfx.jit.compiled import ARGUMENTS, KernelEntry
from featherfx.jit.kernel_calls import describe_arguments
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.shot.loop.simulate import simulate
from featherfx.solver.damping import frequencies
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import State, rest_state

_COLUMNS = "files", "lines"
_CHANGE = "Change here: "


def package_table(folder: Path) -> Iterator[str]:
    """Yield the lines of a Markdown table: each package, its counts, what it holds, what to change.

    The last two are the first line of a package's docstring and its line "Change here: ...".
    """
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for file in sorted(folder.rglob("*.py")):
        found = Counter(files=1, lines=len(file.read_text(encoding="utf-8").splitlines()))
        parents = file.relative_to(folder).parents
        for package in parents:
            if package.parent == Path() or (folder / package / "__init__.py").is_file():
                counts["all" if package == Path() else package.as_posix()] += found
    yield f"| package | {' | '.join(_COLUMNS)} | holds | change here |"
    yield "|---|" + "---|" * (len(_COLUMNS) + 2)
    for name, found in sorted(counts.items(), key=lambda each: (each[0] == "all", each)):
        start = folder / name / "__init__.py"
        text = ast.get_docstring(ast.parse(start.read_text("utf-8"))) if start.is_file() else ""
        lines = (text or "").splitlines()
        holds = lines[0] if lines else ""
        change = next((each for each in lines if each.startswith(_CHANGE)), "")[len(_CHANGE) :]
        numbers = " | ".join(f"{found[each]:,}" for each in _COLUMNS)
        yield f"| {name} | {numbers} | {holds} | {change} |"


CompiledEntry = tuple[str, float, float]


def write_calls(works: Mapping[str, Callable[[], None]]) -> Path:
    """Do some works, and write which kernels Python calls in each, and types of their arguments.

    Kernels that take arrays of records are left out: these have no text to make them of.
    """
    found: dict[str, dict[str, str]] = {}
    for work, do in works.items():
        calls: dict[str, str] = {}
        call = KernelEntry.__call__

        def listed(self: KernelEntry, *arguments: Any, calls: Any = calls, call: Any = call) -> Any:
            if self.name not in calls:
                calls[self.name] = describe_arguments(arguments)
            return call(self, *arguments)

        with patch.object(KernelEntry, "__call__", listed), nothing_kept():
            do()
        found[work] = {name: text for name, text in calls.items() if "[" not in text}
    ARGUMENTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return ARGUMENTS


def measure_entries(work: Callable[[], None]) -> list[CompiledEntry]:
    """Do a work, and return of each entry compiled its name, seconds of lowering and of LLVM."""
    from numba.core.codegen import JITCodeLibrary

    from featherfx.jit import compiler

    entries: list[CompiledEntry] = []
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


def shot_entries(shot: Path) -> list[CompiledEntry]:
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


_ROWS, _BARB_COLUMNS = 21, 6
_SIZES = (0.25, 0.5, 1.0, 2.0, 5.0)
_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2


def _at_rest(solver: Solver) -> State:
    return rest_state(solver.model, np.zeros((1, 3)), np.eye(3)[None])


def scaling_rows(preset: str) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield droop and first frequency of a feather held level, by scaling rule and size.

    Rule, size, droop of the tip and of the lowest barb below its root (feather lengths), Hz.
    """
    for rule in ("similar", "behaviour", "fixed_vane"):
        for size in _SIZES:
            kind = adjusted(replace(feather_kind(preset), scaling=rule), Change(scale=size))
            model = make_model([build_feather(kind, _ROWS, _BARB_COLUMNS)], [kind], 2)
            with Solver(model, Settings(newton=1e-7 * kind.length)) as solver:
                start = _at_rest(solver)
                state, status, _ = solver.equilibrium(start, no_loads(1, _GRAVITY))
            if status[0] != 0:
                raise RuntimeError(f"{preset}, {rule}, size {size}: found no equilibrium.")
            down = (start.points.nodes[0] - state.points.nodes[0])[..., 2] / kind.length
            barbs = (down[:, 1:] - down[:, :1]).max()
            yield rule, size, float(down[-1, 0]), float(barbs), frequencies(model, 0, 1)[0]
