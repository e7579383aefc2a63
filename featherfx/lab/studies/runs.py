"""Run studies, in several processes if wished; kernels are compiled before the times are taken."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from featherfx.errors import SimulationError
from featherfx.lab.feathers.full_feather import FullPull, pull_feather
from featherfx.lab.rods.experiments import ReleaseTest, natural_frequencies, release
from featherfx.lab.rods.rod import Rod
from featherfx.lab.studies.study import Comparisons, Study, StudyResult, ourselves, run_study

# libraries of linear algebra that would start a thread for each core in each process
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Entry:
    """A study and what it found."""

    study: Study
    result: StudyResult


Progress = Callable[[Entry, int, int], None]


def run_all(
    chosen: Sequence[Study],
    folder: Path,
    progress: Progress | None = None,
    jobs: int = 1,
    compile_first: Sequence[Callable[[], None]] | None = None,
) -> list[Entry]:
    """Run studies, pictures into the folder; entries in the order given, whatever ends first.

    A study that the solver cannot finish is on the page as one that differs, with its reason.
    progress: told the entry that is done, how many are, and of how many. jobs: processes; with one
    all runs in this process. compile_first: what compiles the kernels; _FAMILIES if not given.
    """
    first = _FAMILIES if compile_first is None else compile_first
    if jobs > 1 and len(chosen) > 1:
        return _in_processes(chosen, folder, progress, min(jobs, len(chosen)), first)
    for family in first:
        family()
    entries = []
    for study in chosen:
        entries.append(_run(study, folder))
        if progress is not None:
            progress(entries[-1], len(entries), len(chosen))
    return entries


def _in_processes(
    chosen: Sequence[Study],
    folder: Path,
    progress: Progress | None,
    jobs: int,
    compile_first: Sequence[Callable[[], None]],
) -> list[Entry]:
    # a fresh process, not a fork: threads of numba do not survive one
    context = multiprocessing.get_context("spawn")
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        with ProcessPoolExecutor(jobs, context) as pool:
            for family in [pool.submit(each) for each in compile_first]:
                family.result()
            waiting: dict[Future[Entry], int] = {
                pool.submit(_run, study, folder): k for k, study in enumerate(chosen)
            }
            done: dict[int, Entry] = {}
            for future in as_completed(waiting):
                entry = done[waiting[future]] = future.result()
                if progress is not None:
                    progress(entry, len(done), len(chosen))
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
    return [done[k] for k in range(len(chosen))]


def compile_rods() -> None:
    """Compile the barb-curvature solver, which rods share."""
    rod = Rod(1.0, 1.0, segments=8)
    natural_frequencies(rod, 1)
    release(ReleaseTest(rod, 0.01, 1e-3, samples=1))


def compile_nodal() -> None:
    """Compile the nodal solver, with bending of barbs and with hinges."""
    pull = FullPull("tip", 1e-3, parts=1, rows=9, columns=2, nodal=True)
    pull_feather(pull)
    pull_feather(replace(pull, material="isotropic"))


_FAMILIES: tuple[Callable[[], None], ...] = (compile_rods, compile_nodal)


def _run(study: Study, folder: Path) -> Entry:
    try:
        return Entry(study, run_study(study, folder))
    except SimulationError as error:
        rows = Comparisons()
        rows.bound("finished", 0.0, ourselves("the solver"), at_least=1.0, note=str(error))
        return Entry(study, StudyResult(rows))
