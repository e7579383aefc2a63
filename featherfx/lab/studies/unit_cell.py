"""The vane as a lattice of barbs and barbules, and the checks of its elements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import root

from featherfx.errors import SimulationError
from featherfx.groom.materials import VaneMaterial
from featherfx.lab.feathers.feather import feather_kind
from featherfx.lab.networks.network import (
    FibreNetwork,
    chain,
    held_displacements,
    homogenised,
    network_energy,
)
from featherfx.lab.networks.unit_cell import (
    UnitCell,
    barbule_nodes,
    cell_moduli,
    cell_network,
    cell_of,
    scattered,
)
from featherfx.lab.studies.study import Comparisons, Figure, StudyResult, draw, ourselves

_PRESET = "swan_primary"
_SEGMENTS = (4, 8, 16, 32)


def elements(folder: Path) -> StudyResult:
    """Cantilever of bend triplets; a planar network in space; bounds of a cell's energy."""
    rows = Comparisons()
    closed = ourselves("closed form of the discrete cantilever, 1 / (2 n^2), derived here")
    for count in _SEGMENTS:
        force = np.zeros((count + 1, 2))
        force[-1, 1] = 1.0
        fibre = chain(count, 1.0, 1.0, 1.0)
        moved = held_displacements(fibre, np.array([0]), np.zeros((1, 2)), force)
        error = 3.0 * float(moved[-1, 1]) - 1.0
        text = f"error of a cantilever of {count} segments over 1 / (2 n^2)"
        rows.compare(text, 2.0 * count**2 * error, 1.0, 1e-6, closed)
    plane = ourselves("the same network in the plane")
    flat, space = crossing_fibres(2), crossing_fibres(3)
    energies, heights = [], 0.0
    for network in (flat, space):
        held = np.arange(1, network.nodes)
        moved = np.zeros((len(held), network.dimensions))
        moved[:, 0] = 0.1 * np.array([0.0, 1.0, 0.3, -0.4])
        moved[:, 1] = 0.1 * np.array([0.2, 0.0, -0.7, 0.1])
        found = held_displacements(
            network, held, moved, np.zeros((network.nodes, network.dimensions))
        )
        energies.append(network_energy(network, found))
        heights = float(np.abs(found[:, 2:]).max(initial=0.0))
    rows.compare(
        "energy of a planar network in space over that in the plane",
        energies[1] / energies[0],
        1.0,
        1e-12,
        plane,
    )
    rows.bound("height to which it leaves its plane", heights, plane, at_most=1e-12, unit="m")
    cell = cell_of(feather_kind(_PRESET))
    gradients = np.random.default_rng(5).normal(size=(20, 2, 2))
    relaxed, affine = homogenised(cell_network(cell), gradients + gradients.transpose(0, 2, 1))
    ratio = np.diag(relaxed) / np.diag(affine)
    between = ourselves("0 and 1, between which it is by construction")
    note = "of 20 random mean strains"
    least, largest = "energy over its affine bound, least", "energy over its affine bound, largest"
    rows.bound(least, ratio.min(), between, at_least=0.0, note=note)
    rows.bound(largest, ratio.max(), between, at_most=1.0, note=note)
    return StudyResult(rows)


def crossing_fibres(dimensions: int) -> FibreNetwork:
    """Two fibres of two segments that cross at a hinge, node 0, in the xy plane."""
    tips = np.array([[1.0, 0.2], [-1.5, -0.3], [0.3, 1.0], [-0.36, -1.2]])
    span = np.zeros((4, dimensions))
    span[:, :2] = [-tips[1], tips[0], -tips[3], tips[2]]
    length = np.linalg.norm(span, axis=1)
    return FibreNetwork(
        nodes=5,
        ends=np.array([[2, 0], [0, 1], [4, 0], [0, 3]]),
        span=span,
        stretch=np.array([3.0, 3.0, 2.0, 2.0]),
        pairs=np.array([[0, 1], [2, 3]]),
        reach=np.array([length[0] + length[1], length[2] + length[3]]),
        bend=np.array([0.5, 0.7]),
    )


def fitted_cell(cell: UnitCell, across: float, shear: float) -> UnitCell:
    """The cell whose angle and barbule diameter give two measured moduli (Pa).

    The number of crossings is kept whole, so the angle is fitted with the barbule spacing that
    keeps it. Raises SimulationError where there is none.
    """
    crossings = cell.crossings

    def at(values: np.ndarray) -> UnitCell:
        angle = float(np.degrees(np.arctan(np.exp(values[0]))))
        spacing = cell.barb_spacing / np.tan(np.radians(angle)) / crossings
        diameter = cell.barbule_diameter * float(np.exp(values[1]))
        return replace(cell, angle=angle, barbule_spacing=spacing, barbule_diameter=diameter)

    def miss(values: np.ndarray) -> np.ndarray:
        found = cell_moduli(at(values))
        return np.log([found.across / across, found.shear / shear])

    solution = root(miss, np.zeros(2), method="hybr", tol=1e-10)
    if not solution.success or np.abs(solution.fun).max() > 1e-6:
        raise SimulationError("unit cell", 0.0, "no angle and diameter give these moduli")
    return at(solution.x)


def lattice(folder: Path) -> StudyResult:
    """Moduli of the cell of a swan's primary, and the barbules that the measured ones ask for."""
    kind = feather_kind(_PRESET)
    vane = kind.vane_material
    cell = cell_of(kind)
    found = cell_moduli(cell)
    thin = (
        "barbules of 5 micrometres that bend are far softer than the vane that was measured; the"
        " modulus goes as the fourth power of the diameter, which the references do not tell"
    )
    given = ourselves("the preset that the cell is of")
    rows = Comparisons()
    rows.compare(
        "modulus along the barbs", found.along, vane.modulus_along_barbs, 0.01, given, unit="Pa"
    )
    rows.report("modulus across, barbules of 5 um at 45 deg", found.across, unit="Pa", note=thin)
    rows.report("shear modulus, the same", found.shear, unit="Pa")
    text = "bending along the barbs"
    rows.compare(text, found.bending_along, vane.barb_bending_normal, 0.01, given, unit="N m")
    text = "contraction along over strain across"
    source = ourselves("a bound of ours")
    rows.bound(text, found.poisson, source, at_most=0.01, note="Jouve 2024 measured none")
    fitted = fitted_cell(cell, vane.modulus_across_barbs, vane.shear_modulus)
    moduli = cell_moduli(fitted)
    target = ourselves("what it was fitted to")
    note = "what the measured moduli across and in shear ask for"
    rows.report("barbule angle", fitted.angle, unit="deg", note=note)
    rows.report("barbule diameter", fitted.barbule_diameter, unit="m", note=note)
    rows.compare(
        "modulus across, fitted", moduli.across, vane.modulus_across_barbs, 1e-5, target, unit="Pa"
    )
    rows.compare("shear modulus, fitted", moduli.shear, vane.shear_modulus, 1e-5, target, unit="Pa")
    rows.report(
        "bending across, fitted",
        moduli.bending_across,
        unit="N m",
        note=f"the vane's value, chosen by eye in the reference, is {vane.bending_across:g}",
    )
    for degrees in (0.1, 1.0, 3.0):
        bounds = [1.0 / np.linalg.inv(each)[1, 1] for each in scattered(moduli.relaxed, degrees)]
        rows.report(
            f"modulus across over that of straight barbs, directions scattered by {degrees:g}"
            " deg, equal stress",
            bounds[1] / cell.thickness / moduli.across,
            note=f"equal strain {bounds[0] / cell.thickness / moduli.across:.4g}; the vane lies"
            " between, and how neighbours shift decides",
        )
    return StudyResult(rows, _pictured(folder, fitted, vane))


def _pictured(folder: Path, fitted: UnitCell, vane: VaneMaterial) -> tuple[Figure, ...]:
    """The cell, and its moduli over the number of hooks."""
    hooks = np.unique(np.geomspace(1, 2 * fitted.crossings - 1, 9).round().astype(int))
    swept = [cell_moduli(replace(fitted, hooks=int(each))) for each in hooks]

    def paint(canvas: Any) -> None:
        left, right = canvas.subplots(1, 2)
        _paint_cell(left, fitted)
        right.loglog(hooks, [each.across for each in swept], "o-", label="across")
        right.loglog(hooks, [each.shear for each in swept], "s-", label="shear")
        right.axhline(vane.modulus_across_barbs, color="C0", ls=":")
        right.axhline(vane.shear_modulus, color="C1", ls=":")
        right.set(xlabel="hooked crossings of a barbule", ylabel="modulus, Pa")
        right.legend()

    caption = (
        "Left: a gap between two barbs (black) with distal (blue) and proximal (orange) barbules."
        " Right: moduli against the number of hooked crossings; dotted: measured."
    )
    return draw(folder / "unit_cell.png", caption, paint, (9.0, 4.2))


def _paint_cell(axes: Any, cell: UnitCell) -> None:
    distal, proximal, _ = barbule_nodes(cell)
    width, rise = cell.barb_spacing, cell.crossings * cell.height
    for k in range(4):
        base = k * cell.height
        for nodes, root_x, side, colour in (
            (distal, 0.0, 1.0, "C0"),
            (proximal, width, -1.0, "C1"),
        ):
            ratio = (len(nodes) - 1) / (2 * cell.crossings)
            x = 1e6 * np.array([root_x, root_x + side * ratio * width])
            axes.plot(x, 1e6 * np.array([base, base + ratio * rise]), color=colour, lw=0.7)
    for place in (0.0, width):
        axes.plot([1e6 * place] * 2, [0.0, 1e6 * (rise + 3 * cell.height)], "k-", lw=3)
    axes.set_aspect("equal")
    axes.set_xlabel("micrometres")
