"""Moduli of lattices and random networks, and how their equations are solved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np

from featherfx.errors import InputError, Problem, SimulationError
from featherfx.lab.declare import NOT_NEGATIVE, POSITIVE, Range, out_of_range, part, require, value
from featherfx.lab.networks.krylov import Method, Preconditioner, Solved, solve
from featherfx.lab.networks.layouts import (
    FibreSection,
    Layout,
    Mikado,
    Periodic,
    mikado,
    triangular,
)
from featherfx.lab.networks.network import Array, HeldSystem, held_system, homogenised

SHEAR = 0.1
# stretch along x, along y, and simple shear along x
GRADIENTS = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [0, 0]]], dtype=float)
# a share of the affine form below which there is no stiffness, only rounding
NO_STIFFNESS = 1e-9


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
        "m; crossings of a fibre that are nearer to each other are one node.",
        4e-3,
        Range(0.0, 0.1),
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

    def layout(self, periodic: bool) -> Layout:
        """The network without what carries nothing; held at its edges if not periodic.

        Raises InputError with every value that is out of range.
        """
        problems = out_of_range(self, "network")
        if self.lattice == "mikado" and self.dilution != 1.0:
            text = f"{self.dilution:g}; allowed with mikado: 1"
            problems.append(Problem("network", "dilution", text))
        if self.lattice == "triangular" and self.scatter is not None:
            text = f"{self.scatter:g}; allowed with mikado only"
            problems.append(Problem("network", "scatter", text))
        if self.lattice == "mikado" and periodic and not problems and self.width < 2.0:
            text = f"{self.density:g}; allowed: up to a quarter of the number of fibres"
            problems.append(Problem("network", "density", text))
        if self.lattice == "triangular" and periodic and self.size % 2:
            problems.append(Problem("network", "size", f"{self.size}; allowed: even numbers"))
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


def network_moduli(layout: Layout) -> NetworkModuli:
    """Moduli of a periodic network. Raises InputError where a mechanism hinders."""
    network = layout.network
    if not len(network.ends):
        return NetworkModuli(0.0, 0.0, np.nan, np.nan, 0, 0, np.nan)
    with without_mechanism():
        forms = homogenised(network, GRADIENTS)
    relaxed, affine = forms[0] / layout.area, forms[1] / layout.area
    relaxed[np.abs(relaxed) < NO_STIFFNESS * affine.max()] = 0.0
    # the strains that are not asked for are free, and cost nothing where there is no stiffness
    sides = np.linalg.pinv(relaxed[1:, 1:], rcond=NO_STIFFNESS) @ relaxed[1:, 0]
    young = float(relaxed[0, 0] - relaxed[0, 1:] @ sides)
    stiff = young > NO_STIFFNESS * affine.max()
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
    and `minres` take symmetric preconditioners only; `direct` is a sparse factorisation.
    """

    plan: NetworkPlan = part()
    method: Method = value("How to solve.", "pcg")
    preconditioner: Preconditioner = value("Of the iterative methods.", "P_Db")
    tolerance: float = value("Residual, as a share of the forces.", 1e-10, Range(1e-15, 1.0, True))


def sheared_system(layout: Layout) -> HeldSystem:
    """Equations of a network whose held nodes move with a simple shear of SHEAR along x."""
    return held_system(layout.network, layout.held, sheared(layout)[layout.held])


def sheared(layout: Layout) -> Array:
    """(N, 2) m, displacements of all nodes under SHEAR if they are affine."""
    return np.stack([SHEAR * layout.places[:, 1], np.zeros(len(layout.places))], axis=1)


def precondition(test: PreconditionTest) -> Solved:
    """Raises InputError for values out of range and for mechanisms, SimulationError where the
    residual does not come down to the tolerance."""
    require(*out_of_range(test, "network"))
    layout = test.plan.layout(periodic=False)
    if len(layout.held) == layout.network.nodes:
        require(Problem("network", "size", "no node is free; allowed: more rows or fibres"))
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
        text = f"the network has a mechanism ({error}); more bending stiffness holds it"
        raise InputError(Problem("network", "bend", text)) from error
