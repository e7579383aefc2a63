"""Traction of a vane sample: clamped below and above, free at its sides, pulled along y.

Two cases have a closed form, because they deform uniformly: barbs along x (transverse) give the
modulus across, barbs along y (longitudinal) the modulus along. In all others the barbs that leave
one clamp do not reach the other and shear against those that leave the other, unless they are
steep enough to join both. Source: Jouve 2024, chapters 3 to 5.

Locking: error of a tilted test against the number of elements, for ratios of the moduli.

45 degrees, 13 by 18 mm, 5 % strain: Jouve 2024, figures 4.4 and 4.7, and Jouve et al. 2024,
figure 5. The reference of each ratio is an aligned mesh of about 40,000 elements.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.errors import InputError, Problem, require
from featherfx.lab.declare import Range, out_of_range, part, value
from featherfx.lab.vane.sample import (
    FORM,
    Membrane,
    Mesh,
    Moduli,
    Regime,
    Sample,
    aligned_of_size,
    displacement,
    isotropic,
    membrane,
    sample_problems,
    slope,
    strain_problems,
    strains,
    stress,
    unaligned_of_size,
)
from featherfx.lab.vane.statics import MembranePose, NoEquilibrium, Statics

Meshing = Literal["aligned", "unaligned"]
Model = Literal["shell", "inextensible", "isotropic"]

# a slope that changes by more than this share when the elements are four times as many is not
# printed: it tells of the mesh
_MESH_CHANGE = 0.1
ELEMENTS = Range(32, 200_000)
# as of presets
_GUARD = Range(0.0, 1e12, unit="Pa")
_SINGULAR = (
    "singular: one barb joins both clamps from corner to corner; the stress grows without bound"
    " with the modulus along the barbs and depends on the mesh, so none is given"
)
_BRIDGED = (
    "barbs join both clamps: the stress is of the order of the modulus along the barbs, and says"
    " little of the moduli across and in shear"
)
_TAUT = "barbs of constant length join both clamps: the sample cannot be pulled, no stress is given"


@dataclass(frozen=True)
class Traction:
    """Clamp a sample below and above and pull it along y.

    0 degrees is the transverse test, 90 the longitudinal, 45 the tilted one. Where barbs join both
    clamps `regime` and `note` say so; a number that depends on the mesh is not given. Barbs of
    constant length, the limit, need a mesh aligned with them; the limit and the finite modulus are
    different models and give different numbers.
    """

    sample: Sample = part()
    moduli: Moduli = part(along=3.6e8, across=4.8e4, shear=2.8e4)
    strain: float = value("Largest, along y.", 0.05)
    steps: int = value("Equal steps of strain.", 10)
    elements: int = value("Triangles, about.", 8000, ELEMENTS)
    mesh: Meshing = value("With the barbs or not.", "aligned")
    model: Model = value(
        "All three moduli; barbs of constant length; the modulus across for all directions.",
        "shell",
    )
    guard: float = value(
        "Pa, compression guard: what keeps barbs that slide upon each other apart.", 0.0, _GUARD
    )


@dataclass(frozen=True)
class TractionResult:
    """strain, stress: (n,), Pa. slope: Pa, least squares through the origin. stress and slope are
    None where no number can be given; note says why. mesh_change: the slope over that of a mesh
    with a quarter of the elements, less one; None where that was not computed. regime: whether
    barbs join the clamps. elements, unknowns, iterations (Newton's, of all steps), seconds (wall).
    """

    strain: Array
    stress: Array | None
    slope: float | None
    elements: int
    unknowns: int
    iterations: int
    seconds: float
    regime: Regime
    mesh_change: float | None
    note: str


@dataclass(frozen=True)
class PulledSample:
    """A sample pulled step by step. strain, stress: (n,), Pa. pose: the last. statics: solver."""

    strain: Array
    stress: Array
    pose: MembranePose
    statics: Statics

    @property
    def slope(self) -> float:
        """Pa, least squares through the origin."""
        return slope(self.strain, self.stress)


def run_traction(test: Traction) -> TractionResult:
    """Run a test, and a coarser one to see whether its slope is of the sample or of the mesh.

    Raises InputError for values out of range and where there is no equilibrium.
    """
    require(*traction_problems(test))
    begin = time.perf_counter()
    regime, found = test.sample.regime, strains(test.strain, test.steps)
    limit = test.model == "inextensible"
    note = "" if regime == "free" or test.model == "isotropic" else _BRIDGED
    if regime == "diagonal" and test.model == "shell":
        note = _SINGULAR
    if limit and regime != "free":
        note = _TAUT
    if note in (_SINGULAR, _TAUT):
        return TractionResult(
            found, None, None, 0, 0, 0, time.perf_counter() - begin, regime, None, note
        )
    pulled = pull_test(test)
    coarse = pull_test(replace(test, elements=max(int(ELEMENTS.low) // 2, test.elements // 4)))
    change = pulled.slope / coarse.slope - 1.0
    known = abs(change) <= _MESH_CHANGE
    if not known:
        note = f"{note}; " if note else ""
        note += "no number is given, because it depends on the mesh: see mesh_change"
    return TractionResult(
        strain=found,
        stress=pulled.stress if known else None,
        slope=pulled.slope if known else None,
        elements=len(pulled.statics.membrane.nodes),
        unknowns=pulled.statics.unknowns,
        iterations=pulled.pose.iterations,
        seconds=time.perf_counter() - begin,
        regime=regime,
        mesh_change=change,
        note=note,
    )


def pull_test(test: Traction, **options: Any) -> PulledSample:
    """The test itself, without checks of input or mesh. options: of Statics."""
    moduli = isotropic(test.moduli.across) if test.model == "isotropic" else test.moduli
    body = membrane(
        test.sample,
        mesh_of(test, moduli),
        moduli.as_array(),
        inextensible=test.model == "inextensible",
        guard=test.guard,
    )
    statics = Statics(body, clamped(test.sample, body), **options)
    return pull(test.sample, statics, strains(test.strain, test.steps))


def mesh_of(test: Traction, moduli: Moduli) -> Mesh:
    """Mesh of a test; aligned ones resolve the layers that follow from the moduli."""
    if test.mesh == "unaligned":
        return unaligned_of_size(test.sample, test.elements)
    layer = 1.0 if test.model == "inextensible" else np.sqrt(moduli.shear / moduli.along)
    return aligned_of_size(test.sample, test.elements, float(layer))


def clamped(sample: Sample, body: Membrane) -> Flags:
    """(N,) nodes in the clamps."""
    height = body.points[:, 1]
    return (height <= 0.0) | (height >= sample.height)


def pull(
    sample: Sample,
    statics: Statics,
    strain: Array,
    pose: MembranePose | None = None,
    move: Callable[[Statics, MembranePose, Array], MembranePose] = Statics.move,
    of: str = "",
) -> PulledSample:
    """Pull through the strains (n,), from `pose` or from rest. of: the sample in messages. Raises
    InputError."""
    pose = pose or statics.rest()
    rest = statics.membrane.points
    top = rest[:, 1] >= sample.height
    stresses: list[float] = []
    for each in strain:
        moved = displacement(float(each), sample.height)
        try:
            pose = move(statics, pose, rest + np.outer(top, [0.0, moved]))
        except NoEquilibrium as error:
            message = f"no equilibrium at {each:g}: {error}"
            if stresses:
                message += f". There is one up to {strain[len(stresses) - 1]:g}"
            raise InputError(Problem(of, "strain", message)) from error
        force = float(statics.forces(pose)[top, 1].sum())
        stresses.append(stress(force, moved, sample))
    return PulledSample(strain, np.array(stresses), pose, statics)


def traction_problems(test: Traction) -> list[Problem]:
    """Every value of the test that is out of its range."""
    problems = [
        *sample_problems(test.sample),
        *out_of_range(test.moduli, form=FORM),
        *strain_problems(test.strain, test.steps),
    ]
    problems += out_of_range(test, form="{value} is not allowed, must be {allowed}")
    if test.model == "inextensible" and test.mesh == "unaligned":
        message = "'unaligned' has no edges along barbs to keep inextensible, must be aligned"
        problems.append(Problem("", "mesh", message))
    return problems


_SAMPLE = Sample(45.0, 13e-3, 18e-3, 1.2e-4)
_ACROSS, _SHEAR, _STRAIN = 4.8e4, 2.8e4, 0.05
RATIOS = (1.0, 1e2, 1e4, 1e6)
_ELEMENTS = (128, 512, 2048, 8192)
_REFERENCE = 40_000
# Descents on locked meshes pass thousands of shallow minima; they end when a step wins less than
# this share of the energy, which moves their stress by 2 %, against errors of several times it.
_ACCURACY = 1e-3
# unaligned meshes of a higher ratio take descents of minutes beyond this size
_STIFF, _LARGEST_STIFF = 1e3, 2048


class LockingPoint(NamedTuple):
    """ratio: of the moduli along and across. elements: of the mesh. stress: Pa at the strain; nan
    where no equilibrium was found. error: relative to the reference of the ratio. turned: elements
    that are turned over. model: "shell" or "inextensible", whose ratio is infinite."""

    mesh: Meshing
    model: Model
    elements: int
    turned: int
    ratio: float
    stress: float
    error: float


class Reference(NamedTuple):
    """Stress, Pa, of a ratio on the finest mesh, and its elements."""

    ratio: float
    stress: float
    elements: int


@dataclass(frozen=True)
class LockingTest:
    """Aligned and unaligned meshes at 45 degrees and 5 % strain, 13 by 18 mm."""

    ratio: tuple[float, ...] = value("Repeatable.", RATIOS)
    elements: tuple[int, ...] = value("Repeatable.", _ELEMENTS)


@dataclass(frozen=True)
class Locking:
    """points of all meshes; references of all ratios."""

    points: tuple[LockingPoint, ...]
    references: tuple[Reference, ...]

    def error(self, mesh: Meshing, ratio: float) -> list[tuple[int, float]]:
        """(elements, error) of the shell on such meshes at a ratio; infinite: the limit."""
        return [(p.elements, p.error) for p in self.points if (p.mesh, p.ratio) == (mesh, ratio)]


def run_locking(
    ratios: Sequence[float] = RATIOS,
    elements: Sequence[int] = _ELEMENTS,
    reference: int = _REFERENCE,
) -> Locking:
    """Errors on aligned and unaligned meshes, and of the inextensible limit on aligned ones.

    Raises InputError for ratios below 1 or too few elements.
    """
    wrong = [each for each in ratios if not 1.0 <= each <= 1e9]
    problems = [Problem("", "ratio", f"{each:g}: must be 1 to 1e9") for each in wrong]
    for count in (*elements, reference):
        problems += traction_problems(_test(1.0, count, "aligned", "shell"))
    require(*problems)
    points: list[LockingPoint] = []
    references = []
    for ratio in ratios:
        exact, found = _stress(ratio, reference, "aligned", "shell")[:2]
        references.append(Reference(ratio, exact, found))
        for count in elements:
            points.append(_point(ratio, count, "aligned", "shell", exact))
            if ratio < _STIFF or count <= _LARGEST_STIFF:
                points.append(_point(ratio, count, "unaligned", "shell", exact))
    exact, found = _stress(math.inf, reference // 2, "aligned", "inextensible")[:2]
    references.append(Reference(math.inf, exact, found))
    points += [_point(math.inf, count, "aligned", "inextensible", exact) for count in elements]
    return Locking(tuple(points), tuple(references))


def _test(ratio: float, elements: int, mesh: Meshing, model: Model) -> Traction:
    along = _ACROSS * (ratio if math.isfinite(ratio) else 1.0)
    return Traction(_SAMPLE, Moduli(along, _ACROSS, _SHEAR), _STRAIN, 1, elements, mesh, model)


def _stress(ratio: float, elements: int, mesh: Meshing, model: Model) -> tuple[float, int, int]:
    """Pa, elements and turned elements; locked meshes may fold."""
    free = mesh == "unaligned"
    test = _test(ratio, elements, mesh, model)
    pulled = pull_test(test, folding=free, accuracy=_ACCURACY if free else 1e-10)
    turned = pulled.statics.system.turned(pulled.pose.positions)
    return float(pulled.stress[-1]), len(pulled.statics.membrane.nodes), turned


def _point(ratio: float, elements: int, mesh: Meshing, model: Model, exact: float) -> LockingPoint:
    try:
        stress, count, turned = _stress(ratio, elements, mesh, model)
    except InputError:
        stress, count, turned = math.nan, elements, 0
    return LockingPoint(mesh, model, count, turned, ratio, stress, abs(stress / exact - 1.0))
