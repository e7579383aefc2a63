"""Feathers in air beside plates, strips and wings: force of a stream, frequencies, loss."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.barbs import outline_curve
from featherfx.feather.build import build_feather
from featherfx.feather.profiles import at_places, vane_shares
from featherfx.groom.types import FeatherKind
from featherfx.lab.feathers.feather import (
    GRID,
    FallTest,
    StreamTest,
    feather_kind,
    measure_fall,
    measure_stream,
    stream_coefficients,
)
from featherfx.lab.ribbons.rod import ModesTest, Rod, find_rod_modes
from featherfx.lab.studies.study import Comparisons, StudyResult, independent, published
from featherfx.mechanics.air_kernels import area_vectors
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Model
from featherfx.solver.damping import with_damping
from featherfx.solver.step.modes import damped_modes, frequencies

_FLIGHT = ("swan_primary", "primary", "secondary", "tail_feather")
_SHAKEN = (*_FLIGHT, "swan_secondary", "owl_primary", "tertial", "rectrix", "greater_covert")
_DROPPED = ("down", "semiplume", "contour", "primary")
# kg/m^3; deg between two directions of a stream; m/s^2
_AIR, _TURN, _GRAVITY = 1.225, 2.0, 9.81
_LINE = independent("Helmbold 1942: slope of a wing's lift by its aspect ratio")
_PLATES = independent("Lindenburg 2003 (ECN-C--03-025): fit to plates of finite aspect ratio")
_STRIPS = independent(
    "strip theory: pi c^2 / 4 of air a metre, c hooked, as a mass of every direction"
)
_STORK = (
    "Air-permeable hole-pattern and nose-droop control (discovery.researcher.life), abstract, "
    "the foremost primary of a stork at a Reynolds number of 18,000"
)
_WITHERS = "Withers 1981 (J. exp. Biol. 90), summary, wings of birds at Reynolds numbers of 1-5e4"
# middle and half width of Withers' largest lift coefficients and ratios of lift and drag
_LIFT, _GLIDE = (1.0, 0.2), (10.0, 7.0)


def in_air(folder: Path) -> StudyResult:
    """Presets in a stream across the rachis, and vibrations in air and by loss."""
    rows = Comparisons()
    for name in _FLIGHT:
        rows += _pressed(name)
    for name in (*_SHAKEN, "alula", "contour"):
        rows += _slowed(name)
    rows += _lifted("swan_primary")
    rows += _lost()
    for name in _SHAKEN:
        rows += _damped(name)
    for name in _DROPPED:
        rows += _fallen(name)
    return StudyResult(rows)


def _model(name: str) -> tuple[FeatherKind, Model]:
    kind, (rows, columns, coefficients) = feather_kind(name), GRID
    return kind, make_model([build_feather(kind, rows, columns)], [kind], coefficients)


def _areas(kind: FeatherKind, model: Model) -> Array:
    """(n, 1 + 2 m, 3) m^2, area of the vane around each node at rest times its normal."""
    area = np.zeros((*model.mass[0].shape, 3))
    area_vectors(build_feather(kind, *GRID[:2]).rest.nodes, model.cell_stiffness[0], area)
    return area


def _aspect(kind: FeatherKind, area: float) -> float:
    return float((kind.length * (1.0 - kind.calamus)) ** 2 / area)


def _plate(aspect: float, angle: float) -> float:
    """Normal coefficient of a plate by its aspect ratio and an angle, deg (Lindenburg 2003)."""
    sine, finite = np.sin(np.radians(angle)), 0.41 * (1.0 - np.exp(-17.0 / aspect))
    return float(1.98 * sine * (1.0 / (0.56 + 0.44 * sine) - finite))


def _pressed(name: str) -> Comparisons:
    """Normal coefficients: half of what both sides differ by, since plates have no camber."""
    kind, model = _model(name)
    aspect = _aspect(kind, float(np.linalg.norm(_areas(kind, model), axis=-1).sum()))
    angles = np.array([5.0, 10.0, 30.0, 45.0, 60.0, 90.0])
    both = ",".join(f"{each:g}" for each in (*angles, *-angles))
    cn = measure_stream(StreamTest(name, both)).cn
    rows, count = Comparisons(), len(angles)
    for angle, found in zip(angles, 0.5 * (cn[:count] - cn[count:]), strict=True):
        turn = np.radians(angle)
        line = 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect**2 + 4.0)) * turn
        expected, source = (line, _LINE) if angle < 30.0 else (_plate(aspect, angle), _PLATES)
        note = f"aspect ratio {aspect:.2g}"
        note += "; flow begins to leave the vane" if angle == 10.0 else ""
        rows.compare(
            f"normal coefficient of {name} at {angle:g} deg",
            found,
            expected,
            0.1,
            source,
            note=note,
        )
    return rows


def _slowed(name: str) -> Comparisons:
    """First frequency with the air that the vane carries, moduli at rest."""
    kind, model = _model(name)
    feather = build_feather(kind, *GRID[:2])
    nodes, sides = feather.rest.nodes, (kind.leading, kind.trailing)
    row = np.linalg.norm(nodes[:, :, None] - nodes[:, 0], axis=-1).argmin(axis=2)
    place, barb = vane_shares(kind, feather.station), np.linspace(0.0, 1.0, GRID[1] + 1)
    hooked = [
        np.outer(at_places(each.hooked.rachis, place), at_places(each.hooked.barb, barb))
        for each in sides
    ]
    width = np.zeros(len(place))
    for side, (each, part) in enumerate(zip(sides, hooked, strict=True)):
        # a strip goes from the root of one barb to the tip of another
        tips, share = place[row[:, (side + 1) * GRID[1]]], part.mean(axis=1)
        share = 0.5 * (share + np.interp(place, tips, share))
        along, across = outline_curve(each.outline).T
        width += share * np.interp(place, along, across, left=0.0, right=0.0)
    area = np.linalg.norm(_areas(kind, model), axis=-1) * np.hstack([hooked[0], hooked[1][:, 1:]])
    strip = _AIR * np.pi / 4 * kind.length * width[row] * area
    expected = frequencies(model._replace(mass=model.mass + strip), 0, 1)[0]
    found, still = frequencies(model, 0, 1, _AIR)[0], frequencies(model, 0, 1)[0]
    rows, note = (
        Comparisons(),
        f"{still:.3g} Hz in vacuum; air pushes along the vane's normal alone",
    )
    text = f"first frequency of {name} in air"
    rows.compare(text, found, expected, 0.03, _STRIPS, unit="Hz", note=note)
    return rows


def _lifted(name: str) -> Comparisons:
    """Lift across a stream, and drag along it."""
    _, model = _model(name)
    found = []
    for angle in np.radians(np.arange(-90.0, 90.0 + _TURN, _TURN)):
        along = np.array([0.0, -np.cos(angle), np.sin(angle)])
        across = np.array([0.0, np.sin(angle), np.cos(angle)])
        force = stream_coefficients(model, along)
        found.append((abs(float(force @ across)), float(force @ along)))
    lift, drag = np.transpose(found)
    most, glide, rows = float(lift.max()), float((lift / drag).max()), Comparisons()
    note = "air presses on vanes as on flat plates, and camber lifts nothing"
    text = f"largest lift coefficient of {name} in a stream across its shaft"
    rows.compare(text, most, 1.5, 0.2, published(f"{_STORK}: 1.5"), note=note)
    wings = published(f"{_WITHERS}: 0.8 to 1.2")
    rows.compare("the same, beside wings", most, *_LIFT, wings, absolute=True, note=note)
    text = "its largest lift over drag"
    rows.compare(text, glide, 10.0, 0.2, published(f"{_STORK}: nearly 10"), note=note)
    wings = published(f"{_WITHERS}: 3 to 17")
    rows.compare("the same, beside wings", glide, *_GLIDE, wings, absolute=True)
    return rows


def _lost() -> Comparisons:
    """Decrements of a rod whose loss factor is 0.1 from 1 to 200 Hz."""
    rod = Rod(0.3, ei=2e-3, ei2=5e-3, line_mass=0.01, segments=16)
    found, rows = find_rod_modes(ModesTest(rod, 3, 0.1)), Comparisons()
    source = independent("closed form: pi times the loss factor")
    for mode, decrement in enumerate(found.decrements, 1):
        text = f"decrement of mode {mode} of a rod with a loss factor of 0.1"
        note = f"at {found.frequencies[mode - 1]:.3g} Hz"
        rows.compare(text, decrement, 0.1 * np.pi, 0.03, source, absolute=True, note=note)
    return rows


def _damped(name: str) -> Comparisons:
    """Decrements of a feather in air, the shaft's loss factor that of the vane."""
    (kind, model), rows = _model(name), Comparisons()
    loss = kind.vane_material.loss_factor
    shaft = replace(kind.rachis_material, loss_factor=loss)
    kind = replace(kind, rachis_material=shaft)
    found = damped_modes(with_damping(model, [kind]), 0, 3, _AIR)
    source = independent("closed form: pi times the loss factor")
    for mode, decrement in enumerate(found.decrements, 1):
        note = f"at {found.frequencies[mode - 1]:.3g} Hz; of the materials alone"
        text = f"decrement of mode {mode} of {name}"
        rows.compare(text, decrement, np.pi * loss, 0.3 * loss, source, absolute=True, note=note)
    return rows


def _fallen(name: str) -> Comparisons:
    """Speed of a free fall across the vane beside that of a plate of its weight that stays level.

    A feather glides, and barbs that are not hooked feel the speed across them alone (independence
    principle of swept cylinders)."""
    (kind, model), rows = _model(name), Comparisons()
    area = abs(float(_areas(kind, model)[..., 2].sum()))
    drag = 0.5 * _AIR * area * _plate(_aspect(kind, area), 90.0)
    level = np.sqrt(float(model.mass[0].sum()) * _GRAVITY / drag)
    fall = measure_fall(FallTest(name))
    angle = np.degrees(np.arcsin(fall.across / np.hypot(fall.speed, fall.drift)))
    note = f"it falls at {fall.speed:.2g} m/s and drifts at {fall.drift:.2g}, its vane at"
    note += f" {angle:.0f} deg to its way; no publication that we know tells of falls"
    text = f"speed across its vane at which {name} falls"
    rows.compare(text, fall.across, float(level), 0.1, _PLATES, unit="m/s", note=note)
    return rows
