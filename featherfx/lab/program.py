"""Size of packages, and processor time of compiling and of the kernels of an iteration.

Hero and production feather of the benchmarks, in the middle of their shake. Each kernel is called
in a compiled loop; the least of several runs counts. Floating-point operations follow from
formulas where a kernel is a loop over numbers; a product and its sum are two. The peak is that of
BLAS's product of matrices in the same run, with one thread.
"""

from __future__ import annotations

import ast
import hashlib
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
from time import thread_time
from typing import Any
from unittest.mock import patch

import numpy as np

from featherfx.algebra.vector_kernels import copy_values
from featherfx.api import read_shot
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.files.disk_cache import nothing_kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind
from featherfx.jit.compile_workers import SECONDS
from featherfx.jit.compiled import ARGUMENTS, KernelEntry, kernel
from featherfx.jit.kernel_calls import describe_arguments
from featherfx.lab.bench.shake import root_paths, swan_primary
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import expand_wind, no_loads
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.solver.damping import frequencies, with_damping
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.integrator_kernels import integrator_of
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import add_increment, barb_jacobians
from featherfx.solver.types import FORCES_ONLY, WHOLE_STIFFNESS, IntegratorFactors
from featherfx.solver.vane.assembly_kernels import add_rows

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


_FEATHERS = {"hero": (41, 10, 2), "production": (21, 6, 2)}
_STEP, _STEPS = 1.0 / 384.0, 40  # s
_CALLS, _RUNS = 200, 7


@kernel
def _assemblies(count, wanted, model, loads, factors, work):
    for _ in range(count):
        assemble(model, loads, 0, 0.0, factors, wanted, 0.0, work)


@kernel
def _products(count, model, work):
    for _ in range(count):
        add_rows(model, 0, 0.0, True, work)


@kernel
def _jacobians(count, model, work):
    for _ in range(count):
        barb_jacobians(model.shapes, work.now, work.axes, work.jacobian)


@kernel
def _energies(count, model, loads, factors, work):
    for _ in range(count):
        evaluate(model, loads, 0, 0.0, factors, work.trial, work.around)


@kernel
def _increments(count, model, work):
    for _ in range(count):
        right, gradient = work.system.right, work.beam.gradient
        add_increment(model.length[0], work.now, right, 1.0, work.trial, gradient)


@kernel
def _factors(count, band, system):
    for _ in range(count):
        copy_values(band, system.band)
        factorise(system.band, system.panel)


@kernel
def _copies(count, band, system):
    for _ in range(count):
        copy_values(band, system.band)


@kernel
def _solutions(count, right, system):
    for _ in range(count):
        copy_values(right, system.right)
        solve_factored(system.band, system.right)


def _microseconds(call: Callable[[int], None]) -> float:
    """Return the processor time of one call, the least of some runs."""
    call(1)
    best = np.inf
    for _ in range(_RUNS):
        begin = thread_time()
        call(_CALLS)
        best = min(best, thread_time() - begin)
    return float(1e6 * best / _CALLS)


def _peak() -> float:
    """Return the floating-point operations a microsecond of a product of matrices."""
    size, best = 512, np.inf
    a = np.random.default_rng(1).uniform(size=(size, size))
    for _ in range(20):
        begin = thread_time()
        a @ a
        best = min(best, thread_time() - begin)
    return float(2e-6 * size**3 / best)


def _operations(n: int, m: int, c: int) -> float:
    """Return the operations of add_rows.

    K J of all barbs, of shifts as sums of blocks, then their products with J of this row and the
    next two, of rows as forces and moments.
    """
    lanes, wide = 4 * ((m + 1) // 4 + 1), 6 + 2 * c
    along = 108.0 * (wide - 3) + 27.0
    each = 15.0 * wide + 6.0 * (wide - 6) * wide
    return 2.0 * n * lanes * (along + 3.0 * each)


def kernel_rows() -> Iterator[tuple[str, str, float, float | None, float | None]]:
    """Yield feather, kernel, microseconds, operations, and share of the peak."""
    peak = _peak()
    for name in _FEATHERS:
        for kernel_name, (spent, count) in _kernel_times(name).items():
            yield name, kernel_name, spent, count, count and count / spent / peak


def _kernel_times(name: str) -> dict[str, tuple[float, float | None]]:
    """Return microseconds and operations of each kernel for one feather."""
    n, m, c = _FEATHERS[name]
    kind = swan_primary()
    model = with_damping(make_model([build_feather(kind, n, m)], [kind], c), [kind])
    loads = expand_wind(no_loads(1), 1)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    solver = Solver(model, Settings(1e30, 1e-6, 1, 0.8))
    for k in range(_STEPS):
        paths = root_paths(k * _STEP, (k + 1) * _STEP, 1)
        state, _ = solver.step(state, no_loads(1), paths, _STEP)
    work, integrator = solver._work().value, integrator_of(0.8, _STEP)
    factors = IntegratorFactors(integrator.inertia, integrator.rate, 1.0 / _STEP)
    size, width = work.system.band.shape
    assemble(model, loads, 0, 0.0, factors, WHOLE_STIFFNESS, 0.0, work)
    band, right = work.system.band.copy(), work.system.right.copy()
    copied = _microseconds(lambda k: _copies(k, band, work.system))
    calls: dict[str, tuple[Callable[[int], None], float | None]] = {
        "whole assembly": (
            lambda k: _assemblies(k, WHOLE_STIFFNESS, model, loads, factors, work),
            None,
        ),
        "of it K J and products with J": (
            lambda k: _products(k, model, work),
            _operations(n, m, c),
        ),
        "of it derivatives of barbs' nodes": (lambda k: _jacobians(k, model, work), None),
        "forces alone": (lambda k: _assemblies(k, FORCES_ONLY, model, loads, factors, work), None),
        "increment of a pose": (lambda k: _increments(k, model, work), None),
        "points, strains and energy": (lambda k: _energies(k, model, loads, factors, work), None),
    }
    found = {each: (_microseconds(call), count) for each, (call, count) in calls.items()}
    factorised = _microseconds(lambda k: _factors(k, band, work.system)) - copied
    found["factorisation"] = factorised, float(size) * (width - 1) * (width + 2)
    _factors(1, band, work.system)
    solved = _microseconds(lambda k: _solutions(k, right, work.system))
    found["solution"] = solved, 4.0 * size * (width - 1)
    return found


_ROWS, _BARB_COLUMNS = 21, 6
_SIZES = (0.25, 0.5, 1.0, 2.0, 5.0)
_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2


def _at_rest(solver: Solver) -> State:
    return rest_state(solver.model, np.zeros((1, 3)), np.eye(3)[None])


def _segment_changes(feather: Feather, points: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the relative length changes of the barb segments of each side; points: (n, P, 3)."""
    m = feather.columns
    for side in range(2):
        barbs = points[:, 3 + side * m : 3 + (side + 1) * m]
        nodes = np.concatenate([points[:, :1], barbs], axis=1)
        length = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
        present = feather.barb_length[side] > 0.0
        yield length[present] / (feather.barb_length[side, present, None] / m) - 1.0


def _run(path: Path, jobs: int) -> tuple[str, float, float, Simulation]:
    """Return hash of all points, largest change of a segment, wall seconds and simulation."""
    begin = time.perf_counter()
    simulation = simulate(read_shot(path), jobs=jobs)
    digest, worst = hashlib.sha256(), 0.0
    for frame in simulation:
        for feather, points in zip(simulation.feathers, frame.rows, strict=True):
            digest.update(points.tobytes())
            for change in _segment_changes(feather, points):
                worst = max(worst, float(np.abs(change).max(initial=0.0)))
    return digest.hexdigest(), worst, time.perf_counter() - begin, simulation


def _rest_drift(feather: Feather, kind: FeatherKind, coefficients: int) -> float:
    """Return the largest displacement (m) in 1 s without loads, the root held."""
    with Solver(make_model([feather], [kind], coefficients), Settings()) as solver:
        state = start = _at_rest(solver)
        for _ in range(24):
            state, report = solver.step(state, no_loads(1), hold_roots(state), 1.0 / 24.0)
            if report.status.any():
                return float("nan")
    return float(np.linalg.norm(state.points.nodes - start.points.nodes, axis=-1).max())


def _time_error(path: Path) -> float:
    """Return the largest distance from a run with a 50th of the tolerance, in feather lengths."""
    shot = read_shot(path)
    run, worst = simulate(shot), 0.0
    tolerance = 0.02 * min(each.tolerance for each in run.options)
    fine = replace(shot, quality=replace(shot.quality, tolerance=tolerance))
    for one, other in zip(run, simulate(fine), strict=True):
        for placement, a, b in zip(shot.groom.feathers, one.rows, other.rows, strict=True):
            distance = np.linalg.norm(np.delete(a - b, (1, 2), axis=1), axis=2).max()
            worst = max(worst, float(distance) / placement.kind.length)
    return worst


def shot_figures(path: Path) -> dict[str, object]:
    """Measure a shot: times, iterations, and how well it keeps what the model promises."""
    _run(path, 1)  # compiles
    digest, worst, seconds, simulation = _run(path, 1)
    other, _, seconds_of_two, _ = _run(path, 2)
    shot, coefficients = simulation.shot, [each.coefficients for each in simulation.options]
    kind, feather = shot.groom.feathers[0].kind, simulation.feathers[0]
    return {
        "shot": shot.name,
        "feathers": len(simulation.feathers),
        "quality": shot.quality.name,
        "seconds with 1 and 2 threads": [seconds, seconds_of_two],
        "Newton iterations a frame": simulation.report["newton_iterations"],
        "substeps a frame": simulation.report["substeps"],
        "coefficients of the barbs": sorted(set(coefficients)),
        "largest change of a barb segment": worst,
        "drift of the first feather in 1 s, m": _rest_drift(feather, kind, coefficients[0]),
        "error of the substeps, feather lengths": _time_error(path),
        "same bytes with 1 and 2 threads": digest == other,
    }


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
