"""Moduli of lattices and random networks, and how their equations are solved.

Under large strain planar networks take Newton's method from one shear to the next:

    E = sum over segments of EA l / 2 (L / l - 1)^2 + sum over bend triplets of EI / r turn^2

L length of a segment, turn the change of the angle between a triplet's segments; for small strain
that is network.py. Houghton 2020, section 7.1, leaves it as work to do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy import sparse

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.errors import InputError, Problem, SimulationError, require
from featherfx.lab.declare import NOT_NEGATIVE, POSITIVE, Range, out_of_range, part, value
from featherfx.lab.networks.layouts import (
    FibreSection,
    Mikado,
    NetworkLayout,
    Periodic,
    mikado,
    triangular,
)
from featherfx.lab.networks.network import (
    HeldSystem,
    KrylovSolution,
    Method,
    Preconditioner,
    factor_of,
    held_system,
    homogenised,
    solve,
)

SHEAR = 0.1
# stretch along x, along y, and simple shear along x
GRADIENTS = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [0, 0]]], dtype=float)
# a share of the affine form below which there is no stiffness, only rounding
_NO_STIFFNESS = 1e-9


@dataclass(frozen=True)
class NetworkPlan:
    """A lattice or a random network of fibres, of stretching stiffness 1 N.

    Sides of the lattice and fibres of a random network are 1 m long.
    """

    lattice: Literal["triangular", "mikado"] = value("Kind of network.", "triangular")
    size: int = value("Rows of the lattice and nodes in each.", 24, Range(2, 2000))
    dilution: float = value(
        "Probability with which a segment of the lattice is kept, p in the literature; 1 is whole.",
        1.0,
        Range(0.0, 1.0),
    )
    fibres: int = value("Fibres of the random network.", 400, Range(2, 100_000))
    density: float = value(
        "Of the random network: fibres in a square as long as a fibre.", 25.0, POSITIVE
    )
    merge: float = value(
        "m; crossings of a fibre that are nearer to each other are one node.", 4e-3, Range(0.0, 0.1)
    )
    bend: float = value("N m^2, bending stiffness of a fibre.", 2.5e-5, NOT_NEGATIVE)
    scatter: float | None = value(
        "deg, of random fibres' directions about x, normally distributed.  [default: all alike]",
        None,
        Range(0.1, 90.0),
    )
    seed: int = value("Of what is random.", 0, NOT_NEGATIVE)

    @property
    def width(self) -> float:
        """m, side of the random network's square."""
        return float(np.sqrt(self.fibres / self.density))

    def layout(self, periodic: bool) -> NetworkLayout:
        """The network without what carries nothing; held at its edges if not periodic.

        Raises InputError with every value that is out of range.
        """
        problems = out_of_range(self, "network")
        if self.lattice == "mikado" and self.dilution != 1.0:
            text = f"{self.dilution:g} is not allowed with mikado. Give 1"
            problems.append(Problem("network", "dilution", text))
        if self.lattice == "triangular" and self.scatter is not None:
            text = f"{self.scatter:g} is allowed with mikado only"
            problems.append(Problem("network", "scatter", text))
        if self.lattice == "mikado" and periodic and not problems and self.width < 2.0:
            text = f"{self.density:g} is not allowed. Give up to a quarter of the number of fibres"
            problems.append(Problem("network", "density", text))
        if self.lattice == "triangular" and periodic and self.size % 2:
            problems.append(
                Problem("network", "size", f"{self.size} is not allowed. Give even numbers")
            )
        require(*problems)
        section = FibreSection(1.0, self.bend)
        if self.lattice == "mikado":
            plan = Mikado(
                self.fibres,
                self.width,
                merge=self.merge,
                periodic=periodic,
                seed=self.seed,
                scatter=None if self.scatter is None else float(np.radians(self.scatter)),
            )
            return mikado(plan, section).carrying()
        edges: Periodic = "both" if periodic else "no"
        layout = triangular(self.size, self.size, section, edges, self.dilution, self.seed)
        return layout.carrying()


@dataclass(frozen=True)
class NetworkTest:
    """Moduli of a periodic network of fibres that are hinged where they cross.

    The moduli are those of a sheet, N/m. `affinity` is the shear modulus over that of nodes which
    move with the mean strain.
    """

    plan: NetworkPlan = part()


@dataclass(frozen=True)
class NetworkModuli:
    """shear_modulus, young_modulus: N/m, mean strain given and sides free. poisson: of the sheet.
    affinity: shear modulus over the affine one. nodes, segments: that carry. crosslink_density:
    length of a fibre over the mean distance of neighbouring crossings on it."""

    shear_modulus: float
    young_modulus: float
    poisson: float
    affinity: float
    nodes: int
    segments: int
    crosslink_density: float


def network_moduli(layout: NetworkLayout) -> NetworkModuli:
    """Moduli of a periodic network. Raises InputError where a mechanism hinders."""
    network = layout.network
    if not len(network.ends):
        return NetworkModuli(0.0, 0.0, np.nan, np.nan, 0, 0, np.nan)
    with without_mechanism():
        forms = homogenised(network, GRADIENTS)
    relaxed, affine = forms[0] / layout.area, forms[1] / layout.area
    relaxed[np.abs(relaxed) < _NO_STIFFNESS * affine.max()] = 0.0
    # the strains that are not asked for are free, and cost nothing where there is no stiffness
    sides = np.linalg.pinv(relaxed[1:, 1:], rcond=_NO_STIFFNESS) @ relaxed[1:, 0]
    young = float(relaxed[0, 0] - relaxed[0, 1:] @ sides)
    stiff = young > _NO_STIFFNESS * affine.max()
    length = np.linalg.norm(network.span, axis=1)
    return NetworkModuli(
        shear_modulus=float(relaxed[2, 2]),
        young_modulus=young if stiff else 0.0,
        poisson=float(sides[0]) if stiff else np.nan,
        affinity=float(relaxed[2, 2] / affine[2, 2]),
        nodes=network.nodes,
        segments=len(length),
        crosslink_density=float(1.0 / length.mean()),
    )


@dataclass(frozen=True)
class PreconditionTest:
    """Solve a sheared network whose edges are held, with a choice of method and preconditioner.

    The lattice is held at its lowest and highest row, the random network at all four sides. `pcg`
    and `minres` take symmetric preconditioners only; `direct` is a sparse factorisation by SuperLU.
    """

    plan: NetworkPlan = part()
    method: Method = value("How to solve.", "pcg")
    preconditioner: Preconditioner = value("Of the iterative methods.", "P_Db")
    tolerance: float = value("Residual, as a share of the forces.", 1e-10, Range(1e-15, 1.0, True))


def sheared_system(layout: NetworkLayout) -> HeldSystem:
    """Equations of a network whose held nodes move with a simple shear of SHEAR along x."""
    return held_system(layout.network, layout.held, sheared(layout)[layout.held])


def sheared(layout: NetworkLayout) -> Array:
    """(N, 2) m, displacements of all nodes under SHEAR if they are affine."""
    return np.stack([SHEAR * layout.places[:, 1], np.zeros(len(layout.places))], axis=1)


def precondition(test: PreconditionTest) -> KrylovSolution:
    """Raises InputError for values out of range and for mechanisms, SimulationError where the
    residual does not come down to the tolerance."""
    require(*out_of_range(test, "network"))
    layout = test.plan.layout(periodic=False)
    if len(layout.held) == layout.network.nodes:
        require(Problem("network", "size", "no node is free. Give more rows or fibres"))
    with without_mechanism():
        found = solve(sheared_system(layout), test.method, test.preconditioner, test.tolerance)
    # the residual that a method keeps by recurrence drifts from the true one by rounding
    if found.residual > 10.0 * test.tolerance and test.method != "direct":
        text = f"{found.iterations} iterations leave a residual of {found.residual:.3g}"
        raise SimulationError("network", 0.0, text)
    return found


@contextmanager
def without_mechanism() -> Iterator[None]:
    """Failures of the linear algebra as InputError."""
    try:
        yield
    except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
        text = f"the network has a mechanism ({error}). More bending stiffness holds it"
        raise InputError(Problem("network", "bend", text)) from error


# iterations, halvings of a step, and a step over the width that is the last
_ITERATIONS, _HALVINGS, _CLOSE = 200, 20, 1e-9
# share of the diagonal that keeps the matrix regular; it only shortens steps
_GROUND = 1e-9


class _Pose(NamedTuple):
    """energy: J. gradient: (2 N,) N. matrix: (2 N, 2 N) N/m, without what compression takes off."""

    energy: float
    gradient: Array
    matrix: sparse.csr_array


def sheared_energies(layout: NetworkLayout, shears: Array) -> Array:
    """(n,) J, at rest, with the held nodes moved along x by shears (n,) times their height.

    Raises SimulationError where a shear has no rest.
    """
    free = np.setdiff1d(np.arange(layout.network.nodes), layout.held)
    inner = (2 * free[:, None] + np.arange(2)).ravel()
    moved, last, found = np.zeros(2 * layout.network.nodes), 0.0, []
    for shear in shears:
        moved[::2] += (shear - last) * layout.places[:, 1]
        moved, energy = _rest(layout, moved, inner)
        last = float(shear)
        found.append(energy)
    return np.array(found)


def _rest(layout: NetworkLayout, moved: Array, inner: Indices) -> tuple[Array, float]:
    pose = _pose(layout, moved)
    for _ in range(_ITERATIONS):
        matrix = pose.matrix[inner][:, inner]
        ground = sparse.diags_array(_GROUND * matrix.diagonal() + 1e-300)
        step = np.zeros_like(moved)
        step[inner] = -factor_of(matrix + ground).solve(pose.gradient[inner])
        slope = float(pose.gradient @ step)
        fraction = 1.0
        for _ in range(_HALVINGS):
            trial = _pose(layout, moved + fraction * step)
            if trial.energy <= pose.energy + 1e-4 * fraction * slope + 1e-15 * pose.energy:
                break
            fraction *= 0.5
        moved, pose = moved + fraction * step, trial
        if np.abs(fraction * step).max() < _CLOSE * layout.size.max():
            return moved, pose.energy
    raise SimulationError("network", 0.0, f"no rest in {_ITERATIONS} iterations")


def _pose(layout: NetworkLayout, moved: Array) -> _Pose:
    network = layout.network
    each = np.arange(len(network.ends))
    shape = (len(each), network.nodes)
    ones = np.ones(len(each))
    difference = sparse.csr_array((ones, (each, network.ends[:, 1])), shape=shape)
    difference -= sparse.csr_array((ones, (each, network.ends[:, 0])), shape=shape)
    to_spans = sparse.kron(difference, np.eye(2)).tocsr()
    span = network.span + (to_spans @ moved).reshape(-1, 2)
    rest, length = np.linalg.norm(network.span, axis=1), np.linalg.norm(span, axis=1)
    along = span / length[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    pull = network.stretch * (length / rest - 1.0)
    # compressed segments would make the matrix indefinite; without that part steps still descend
    stiff = (network.stretch / rest)[:, None, None] * along[:, :, None] * along[:, None]
    stiff += np.maximum(pull / length, 0.0)[:, None, None] * aside[:, :, None] * aside[:, None]
    first, second = network.pairs.T
    turn = _angle(span[first], span[second]) - _angle(network.span[first], network.span[second])
    hinge = np.arange(len(turn))
    by_span = (aside / length[:, None]).ravel()
    rows, columns, values = [], [], []
    for segment, sign in ((second, 1.0), (first, -1.0)):
        for axis in range(2):
            rows.append(hinge)
            columns.append(2 * segment + axis)
            values.append(sign * by_span[2 * segment + axis])
    place = (np.concatenate(rows), np.concatenate(columns))
    turns = sparse.csr_array((np.concatenate(values), place), shape=(len(hinge), 2 * len(each)))
    weight = 2.0 * network.bend / network.reach
    energy = 0.5 * float(network.stretch @ (rest * (length / rest - 1.0) ** 2))
    energy += 0.5 * float(weight @ turn**2)
    force = (pull[:, None] * along).ravel() + turns.T @ (weight * turn)
    index = np.arange(len(each) + 1)
    blocks = sparse.bsr_array((stiff, index[:-1], index), shape=(2 * len(each),) * 2)
    whole = blocks.tocsr() + turns.T @ sparse.diags_array(weight) @ turns
    return _Pose(energy, to_spans.T @ force, (to_spans.T @ whole @ to_spans).tocsr())


def _angle(one: Array, other: Array) -> Array:
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.arctan2(cross, dots(one, other))
