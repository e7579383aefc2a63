"""The solver as the rest of the program calls it: step and equilibrium of a batch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import local
from typing import TypeVar

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import SimulationError, as_figure
from featherfx.files.process import limit_threads
from featherfx.jit.compiled import KernelModule, request_expected
from featherfx.jit.kernel_calls import Encoded
from featherfx.limits import MAX_JOBS
from featherfx.mechanics.model import Loads, Model, expand_wind
from featherfx.solver.scratch import make_scratch
from featherfx.solver.state import RootPath as RootPath
from featherfx.solver.state import State as State
from featherfx.solver.state import StepReport as StepReport
from featherfx.solver.state import carry_to, make_report
from featherfx.solver.state import hold_roots as hold_roots
from featherfx.solver.types import CONVERGED, StepSettings, reason_of

_Part = TypeVar("_Part")
energy_kernels = KernelModule("featherfx.solver.step.energy_kernels")
frame_kernels = KernelModule("featherfx.solver.step.frame_kernels")
step_control_kernels = KernelModule("featherfx.solver.step.step_control_kernels")
settle_kernels = KernelModule("featherfx.solver.settle_kernels")

MAX_NEWTON_ITERATIONS = 32
# the same of one feather in one frame, a bound on work alone; bakes of the samples need 3 to 100,
# crumpled feathers that are flung about up to 13,000
MAX_FRAME_ITERATIONS = 20_000
# the same of a bake, times the unknowns of the feather: about half a second of CPU time; fewest
_MAX_FRAME_WORK, _MIN_FRAME_ITERATIONS = 400_000, 2000
# Newton iterations beyond which the next step is not made longer
HARD_STEP_WORK = 12
# of the feather's length, error that a step may not exceed where it can be shorter
COARSE_ERROR_RATIO = 0.01
# the same, distance from its solution at which a step is taken where a frame must end; what Newton
# adds to a hard matrix overstates it
UNSOLVED_DISTANCE_RATIO = 100.0
# feathers that a thread takes at once, or nodes of these where that is more: what Python hands over
# takes 200 microseconds a call, and an interrupt waits for its end; pieces for each thread at least
FEATHERS_PER_PIECE, _NODES_PER_PIECE, _PIECES_PER_THREAD = 32, 6000, 8
# the same of feathers that settle, which may take as long as a hundred steps each
_SETTLED_PER_PIECE, _SETTLED_NODES_PER_PIECE = 8, 2000
# of the tolerance of a step, distance from the solution that counts as rest at most
_REST_TOLERANCE_RATIO = 1e-2

# J/kg, of keratin of 2.5 GPa (Bonser and Purslow 1995) and 1300 kg/m3 that is strained by a tenth
# throughout, about where it breaks
_BREAKING_ENERGY = 1e4


@dataclass(frozen=True)
class Settings:
    """Settings of the steps of a batch.

    tolerance: m, local error of a step that the substepping keeps to. newton: m, distance from a
    step's solution that counts as converged. max_substeps: substeps of a frame at most, by default
    as many as its work allows (those that Newton cannot solve are cut further). max_iterations: of
    Newton, of one feather in one frame, those with a matrix at hand counted as quarters; one that
    needs more stops with a status. spectral_radius: at infinite frequency, 0 (most damping of what
    a step does not resolve) to 0.9 (energy is nearly conserved). At 1 nothing damps the constraint
    of inextensible barbs and rachises, and the steps become unstable.
    """

    tolerance: float = 1e-4
    newton: float = 1e-6
    max_substeps: int = MAX_FRAME_ITERATIONS
    spectral_radius: float = 0.0
    max_iterations: int = MAX_FRAME_ITERATIONS


def limit_iterations(unknowns: int) -> int:
    """Return the Newton iterations that a bake allows a feather of so many unknowns in a frame.

    What flutters faster than frames show, or is crumpled, would take all that it may.
    """
    fitting = _MAX_FRAME_WORK // max(unknowns, 1)
    return min(MAX_FRAME_ITERATIONS, max(_MIN_FRAME_ITERATIONS, fitting))


def step_settings(settings: Settings, duration: float, length: float = 1.0) -> StepSettings:
    """Settings as the kernels take them, of a frame of duration (s).

    length: m, of a feather; 1 where coarse and unsolved are to be parts of it.
    """
    return StepSettings(
        duration=float(duration),
        shortest=float(duration / settings.max_substeps),
        spectral_radius=float(settings.spectral_radius),
        tolerance=float(settings.tolerance),
        coarse=COARSE_ERROR_RATIO * float(length),
        newton=float(settings.newton),
        iterations=MAX_NEWTON_ITERATIONS,
        hard=HARD_STEP_WORK,
        most_iterations=int(settings.max_iterations),
        unsolved=UNSOLVED_DISTANCE_RATIO * float(length),
    )


class Solver:
    """Steps a batch; holds what does not change between steps, and the threads.

    model: constant data. settings: how to step. jobs: threads at most, no more than feathers; every
    feather is computed by one thread from its own data only, so the result does not depend on how
    many there are. A context manager that ends the threads.
    """

    def __init__(self, model: Model, settings: Settings, jobs: int = 1) -> None:
        self.model, self.settings = model, settings
        self._local = local()
        self.jobs = min(jobs, model.feathers, MAX_JOBS)
        self._pool = ThreadPoolExecutor(self.jobs - 1) if self.jobs > 1 else None
        request_expected("bake", package="featherfx.solver")

    def __enter__(self) -> Solver:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def step(
        self,
        state: State,
        loads: Loads,
        path: RootPath,
        duration: float,
        feathers: Sequence[int] | None = None,
    ) -> tuple[State, StepReport]:
        """Advance feathers by a duration in s; the given state is not changed.

        A feather whose path begins elsewhere than its root is carried there first (see carry_to).

        feathers: indices to advance, all by default. A feather that cannot be solved stays at its
        last good substep and has a status in the report: see raise_if_failed.
        """
        new = state.copy()
        carry_to(self.model.held, new, path)
        report = self.advance(new, loads, path, duration, feathers)
        for f in np.flatnonzero((report.status != CONVERGED) & (report.steps == 0)):
            # not even where its path begins
            new.take(state, int(f))
        return new, report

    def advance(
        self,
        state: State,
        loads: Loads,
        path: RootPath,
        duration: float,
        feathers: Sequence[int] | None = None,
    ) -> StepReport:
        """Advance feathers by a duration in s in place.

        A feather that cannot be solved stays at its last good substep.
        """
        loads = expand_wind(loads, self.model.feathers)
        report = make_report(self.model.feathers)

        frame = step_settings(self.settings, duration)
        some = range(self.model.feathers) if feathers is None else feathers
        model, acting, led, now, how, told = map(
            Encoded, (self.model, loads, path, state, frame, report)
        )

        def take(piece: Indices) -> None:
            work = self._work()
            frame_kernels.advance_feathers(model, acting, piece, led, now, how, work, told)

        self.for_each(take, self._pieces(some, FEATHERS_PER_PIECE, _NODES_PER_PIECE))
        return report

    def equilibrium(
        self,
        state: State,
        loads: Loads,
        fraction: float = 0.0,
        feathers: Sequence[int] | None = None,
    ) -> tuple[State, Array, Array]:
        """Bring feathers to rest under their loads; the given state is not changed.

        fraction: 0..1, place within the loads' frame (grips). feathers: indices, all by default.
        Returns the state, and per feather the status (0: at rest within settings.newton and
        _REST_TOLERANCE_RATIO; NO_REST: it flutters in the wind, and the pose is one on its way;
        SEVERAL_RESTS: at rest, but the wind at once leads elsewhere) and the Newton iterations.
        """
        from featherfx.solver.types import SettleResult, make_mixing

        near = min(self.settings.newton, _REST_TOLERANCE_RATIO * self.settings.tolerance)
        new, loads = state.copy(), expand_wind(loads, self.model.feathers)
        found = SettleResult(np.zeros(self.model.feathers), np.zeros(self.model.feathers))
        goal = float(fraction), float(near)
        some = range(self.model.feathers) if feathers is None else feathers

        def settle(piece: Indices) -> None:
            mixing, work = make_mixing(new.points.nodes[0].size), self._work()
            settle_kernels.settle_feathers(self.model, loads, piece, goal, new, found, mixing, work)

        self.for_each(settle, self._pieces(some, _SETTLED_PER_PIECE, _SETTLED_NODES_PER_PIECE))
        return new, found.status, found.iterations

    def _pieces(self, some: Sequence[int], feathers: int, nodes: int) -> list[Indices]:
        """Divide some feathers into pieces of so many each, or of so many nodes where these are
        more."""
        most = max(feathers, nodes // (self.model.rows * (1 + 2 * self.model.columns)))
        return divide_feathers(np.array(some, dtype=np.int64), self.jobs, most)

    def _work(self) -> Encoded:
        """Scratch of the calling thread."""
        if not hasattr(self._local, "work"):
            self._local.work = Encoded(make_scratch(self.model))
        work: Encoded = self._local.work
        return work

    def for_each(self, function: Callable[[_Part], None], parts: Iterable[_Part]) -> None:
        """Call a function with each part, by all threads; the calling one is the first of them,
        which nobody has to wake."""
        threads = limit_threads(self.jobs)
        if self._pool is None or threads == 1:
            for part in parts:
                function(part)
            return
        # every thread takes the next one when it is free
        waiting = iter(list(parts))

        def work() -> None:
            for part in waiting:
                function(part)

        others = [self._pool.submit(work) for _ in range(threads - 1)]
        work()
        for other in others:
            other.result()


def divide_feathers(feathers: Indices, jobs: int, most: int = FEATHERS_PER_PIECE) -> list[Indices]:
    """Feathers (K,) in pieces, of `most` at most, that threads take one after the other."""
    size = max(1, min(most, len(feathers) // (_PIECES_PER_THREAD * jobs) if jobs > 1 else most))
    return [feathers[k : k + size] for k in range(0, len(feathers), size)]


def raise_if_failed(
    status: Array,
    time: Array,
    names: Sequence[str],
    most: int = MAX_FRAME_ITERATIONS,
    cause_of: Callable[[int], str] | None = None,
) -> None:
    """SimulationError for the first feather with a status; it tells how many more there are.

    most: Settings.max_iterations. cause_of: what is amiss with a feather, where it is (overload).
    """
    bad = np.flatnonzero(status != CONVERGED)
    if len(bad) == 0:
        return
    first = int(bad[0])
    reason = reason_of(int(status[first]), most)
    cause = cause_of(first) if cause_of is not None else ""
    reason += f"; {cause}" if cause else ""
    if len(bad) > 1:
        reason += f" (and {len(bad) - 1} more feathers)"
    raise SimulationError(names[first], float(time[first]), reason)


def specific_energy(model: Model, state: State, f: int) -> float:
    """Elastic energy of feather f over its mass, J/kg."""
    strains, gaps = state.strains.at(f, 0), state.gaps_of(f)
    energy = float(energy_kernels.elastic_energy(model, f, strains, strains, gaps, 0.0, 0.0))
    return energy / float(model.mass[f].sum())


def describe_overload(held: float) -> str:
    """Describe the overload of a feather that holds so much (J/kg); empty where it is none."""
    if not held > _BREAKING_ENERGY:
        return ""
    return (
        f"its pose holds {as_figure(held)} J/kg, {as_figure(held / _BREAKING_ENERGY)} times what"
        " keratin breaks at: look at how its root moves, at grips and forces, and at its stiffness"
    )


def overload_describer(model: Model, state: State) -> Callable[[int], str]:
    """Return the function that describes the overload of feather f of a state, for
    raise_if_failed."""
    return lambda f: describe_overload(specific_energy(model, state, f))
