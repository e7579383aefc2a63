"""A plate in air: how it falls, tumbles and vibrates, and what air that accelerates does to it."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq

from featherfx.feather.build import build_feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape
from featherfx.lab.feather import stream_coefficients
from featherfx.mechanics.air_kernels import carried_energy, pressed_share
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import damped_modes, frequencies
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state

pytestmark = pytest.mark.verification

LENGTH, WIDTH, DENSITY = 0.2, 0.04, 0.5
AIR, NORMAL, GRAVITY = 1.2, 1.2, 9.81


def plate(half_width=WIDTH, attached=0.0):
    """A flat rectangle 0.2 x 0.08 m, 0.5 kg/m^2, with a thin light shaft; far stiffer than air."""
    vane = VaneMaterial(
        modulus_along_barbs=3.6e8,
        modulus_across_barbs=4.8e7,
        shear_modulus=2.8e7,
        thickness=1.2e-4,
        surface_density=DENSITY,
        barb_bending_normal=10.0,
        barb_bending_in_plane=10.0,
        barb_taper=0.0,
        bending_across=1e-2,
        loss_factor=0.2,
        attached_coefficient=attached,
    )
    shaft = RachisMaterial(
        youngs_modulus=5e11,
        shear_modulus=1.5e11,
        cortex_fraction=1.0,
        cortex_density=1.0,
        core_density=1.0,
        loss_factor=0.2,
    )
    width = half_width / LENGTH
    side = VaneShape(
        ((0.0, 0.0), (0.0, width), (1.0, width), (1.0, 0.0)), (BarbGuide(0.5, 90.0, 0.0, 0.0),)
    )
    straight = RachisShape(1e-3, 1e-3, 1.0, 0.0, 0.0, 0.0)
    return FeatherKind(
        name="plate",
        length=LENGTH,
        calamus=0.0,
        rachis=straight,
        leading=side,
        trailing=side,
        vane_material=vane,
        rachis_material=shaft,
    )


def falling(added_mass, permeability=0.0):
    """Model of a free plate, still air that it carries or does not, its state, the area that the
    air meets, and m_a / m."""
    kind = plate()
    kind = replace(kind, vane_material=replace(kind.vane_material, permeability=permeability))
    feather = build_feather(kind, 9, 3)
    model = make_model([feather], [kind], 1)._replace(held=np.zeros(1, dtype=np.bool_))
    rest = model.cell_rest[0][feather.cell]
    area = float(np.sum(0.5 / (rest[:, 0] * rest[:, 2])))
    assert area == pytest.approx(2 * WIDTH * LENGTH, rel=1e-9)
    carried = (1.0 - permeability) * AIR * np.pi / 4 * (2 * WIDTH) ** 2 * LENGTH
    assert AIR * model.air_volume.sum() == pytest.approx(carried, rel=1e-9)
    loads = no_loads(1)._replace(
        air=np.array([AIR, NORMAL, 0.02, 0.0]), added_mass=np.full(1, added_mass)
    )
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    return model, loads, state, area, added_mass * carried / model.mass.sum()


def borne(permeability, resistance, speed):
    """Part of a closed plate's load: root of the pressure lost over that which turns aside."""

    def loss(x):
        rise = NORMAL * (1.0 - permeability) / permeability**2 if permeability else 0.0
        return 2.0 * resistance / (AIR * speed) * x + rise * x * x

    def load(x):
        root = np.sqrt(NORMAL)
        return 4.0 * x * (1.0 - x) if x > 0.5 * root else NORMAL - 4.0 * (root - 1.0) * x

    return loss(brentq(lambda x: loss(x) - load(x), 0.0, 1.0)) / NORMAL


def test_a_vane_that_air_passes_bears_what_turns_aside():
    """Openings alone, pores alone (Darcy) and both, beside the root of the balance.

    Nearly open, a vane bears what its strips bear one by one; slow, all of it."""
    air = np.array([AIR, NORMAL, 0.02, 0.0])
    for gaps, resistance, speed in product(
        (0.0, 0.1, 0.5, 0.8), (0.0, 0.3, 20.0), (0.1, 2.0, 30.0)
    ):
        if gaps or resistance:
            passing = np.array([resistance, (1.0 - gaps) / gaps**2 if gaps else 0.0])
            expected = borne(gaps, resistance, speed)
            assert pressed_share(passing, air, speed) == pytest.approx(expected, abs=1e-9)
    open_, pores, shut = np.array([[0.0, 0.01 / 0.99**2], [0.3, 1.0], [np.inf, 0.0]])
    assert pressed_share(open_, air, 5.0) == pytest.approx(0.01, rel=0.02)
    assert pressed_share(pores, air, 1e-6) == pytest.approx(1.0, abs=1e-5)
    assert pressed_share(np.zeros(2), air, 5.0) == 0.0
    assert pressed_share(shut, air, 5.0) == pressed_share(pores, air, 0.0) == 1.0


@pytest.mark.parametrize("side", [0, 1])
def test_each_vane_passes_its_own_air(side):
    """The wind along the normal at one open vane: the other bears as before, this one nothing."""
    kind, gaps = plate(), [0.0, 0.0]
    gaps[side] = 1.0
    half = replace(kind, vane_material=replace(kind.vane_material, permeability=tuple(gaps)))
    whole, one = (make_model([build_feather(each, 9, 3)], [each], 1) for each in (kind, half))
    wind = np.array([0.0, 0.0, 5.0])
    assert stream_coefficients(one, wind)[2] == pytest.approx(
        0.5 * stream_coefficients(whole, wind)[2]
    )
    nodes = slice(1 + 3 * side, 4 + 3 * side)
    assert not one.air_volume[0][:, nodes].any()
    assert one.air_volume.sum() == pytest.approx(0.5 * whole.air_volume.sum())


def mean_velocity(model, state):
    return np.einsum("np,npk->k", model.mass[0], state.velocity.nodes[0]) / model.mass[0].sum()


@pytest.mark.parametrize("air", [(0.0, 0.0), (1.0, 0.0), (0.25, 0.0), (1.0, 0.4)])
def test_terminal_speed_is_the_balance_of_weight_and_quadratic_drag(air):
    """m g = 1/2 rho S C v^2, and the way there: v = v_t tanh(g t / v_t / (1 + m_a / m))."""
    model, loads, state, area, carried = falling(*air)
    loads = loads._replace(gravity=np.array([0.0, 0.0, -GRAVITY]))
    solver = Solver(model, Settings(tolerance=1e-5, newton=1e-9))
    area *= borne(air[1], 0.0, 1.0) if air[1] else 1.0
    terminal = np.sqrt(2.0 * model.mass.sum() * GRAVITY / (AIR * area * NORMAL))
    interval = 0.2 * terminal / GRAVITY * (1.0 + carried)
    for k in range(1, 26):
        state, report = solver.step(state, loads, hold_roots(state), interval)
        assert report.status[0] == 0
        mean, expected = mean_velocity(model, state), terminal * np.tanh(0.2 * k)
        assert mean == pytest.approx([0.0, 0.0, -expected], abs=0.01 * terminal)
    assert -mean[2] == pytest.approx(terminal, rel=2e-3)


@pytest.mark.parametrize("travels", [False, True])
def test_air_pushes_by_its_own_acceleration(travels):
    """(m + m_a) dv/dt = m_a Du/Dt where nothing drags: u = A cos(w t + p) all over, or a gust that
    travels with the air, which does not accelerate it (Auton, Hunt and Prud'homme 1988)."""
    model, loads, state, _, carried = falling(1.0)
    amplitude, rate, phase = 2.0, 9.0, 1.0
    loads = loads._replace(air=np.array([AIR, 0.0, 0.0, 0.0]))
    if travels:
        loads = loads._replace(
            wind_wave=np.array([[rate], [0.0], [0.0]]),
            wind_rate=np.full(1, rate),
            wind_mean=np.array([[1.0, 0.0, 0.0]]),
            wind_amplitude=np.array([[0.0], [0.0], [amplitude]]),
            wind_phase=np.full(1, phase),
        )
    solver = Solver(model, Settings(tolerance=1e-6, newton=1e-10))
    for k in range(1, 11):
        blown = 0.0
        if not travels:
            speeds = amplitude * np.cos(rate * 0.05 * np.array([k - 1, k, 0]) + phase)
            change = np.array([[0.0, 0.0, (speeds[1] - speeds[0]) / 0.05]])
            loads = loads._replace(wind_change=change)
            blown = speeds[1] - speeds[2]
        state, report = solver.step(state, loads, hold_roots(state), 0.05)
        assert report.status[0] == 0
        expected = blown * carried / (1.0 + carried)
        assert mean_velocity(model, state)[2] == pytest.approx(expected, abs=0.01 * amplitude)


def test_air_gives_back_what_it_takes_of_a_plate_that_tumbles():
    """Kinetic energy of plate and air together stays; that of the plate alone does not."""
    model, loads, state, _, _ = falling(1.0)
    loads = loads._replace(air=np.array([AIR, 0.0, 0.0, 0.0]))
    spin = np.array([25.0, 6.0, 0.0])
    middle = np.einsum("np,npk->k", model.mass[0], state.points.nodes[0]) / model.mass[0].sum()
    turning = np.cross(spin, state.points.nodes[0] - middle)
    state.velocity.nodes[0] = turning + np.array([0.0, 0.4, 0.8])
    state.velocity.directors[0] = np.cross(spin, state.points.directors[0])
    solver = Solver(model, Settings(tolerance=1e-5, newton=1e-10))
    around, plates, totals = make_scratch(model).around, [], []
    for _ in range(25):
        nodes, velocity = state.points.nodes[0], state.velocity.nodes[0]
        directors = state.velocity.directors[0]
        own = 0.5 * np.sum(model.mass[0][..., None] * velocity**2)
        own += 0.5 * np.sum(model.rotary_inertia[0][..., None] * directors**2)
        plates.append(own)
        totals.append(own + carried_energy(model, loads, 0, nodes, velocity, around))
        state, report = solver.step(state, loads, hold_roots(state), 0.01)
        assert report.status[0] == 0
    assert np.ptp(plates) > 0.06 * totals[0]
    assert np.array(totals) == pytest.approx(totals[0], rel=0.006)


def test_still_air_lowers_frequencies_as_more_mass_of_the_vane_would():
    """Of a plate: f / (1 + rho pi c / 4 / sigma)^(1/2), c its width, sigma its mass an area."""
    kind = plate()
    model = make_model([build_feather(kind, 21, 3)], [kind], 1)
    ratio = 1.0 + AIR * np.pi / 4 * 2 * WIDTH / DENSITY
    for part in (1.0, 0.4):
        leaky = model._replace(air_volume=part * model.air_volume)
        lower = frequencies(leaky, 0, 1, AIR) / frequencies(model, 0, 1)
        assert lower == pytest.approx((1.0 + part * (ratio - 1.0)) ** -0.5, rel=2e-3)
    damped = model._replace(retardation=np.full((1, 2), 1e-3))
    first = frequencies(model, 0, 1)
    assert damped_modes(damped, 0, 1).decrements == pytest.approx(2e-3 * np.pi**2 * first, rel=0.01)


def test_a_plate_that_is_let_go_swings_with_its_air_and_a_stream_feeds_no_edge():
    """Bent by gravity: its frequency falls as that of its first mode. Neither a stream to the free
    end nor one from it, or from either edge, makes it swing farther."""
    kind = plate()
    vane = replace(kind.vane_material, surface_density=0.05)
    shaft = replace(kind.rachis_material, youngs_modulus=1e11)
    kind = replace(kind, vane_material=vane, rachis_material=shaft)
    model = make_model([build_feather(kind, 21, 3)], [kind], 1)
    speed = 3.0
    found, known = {}, {air: frequencies(model, 0, 1, AIR * air)[0] for air in (0.0, 1.0)}
    for air, stream in ((0.0, 0.0), (1.0, 0.0), (1.0, speed)):
        loads = no_loads(1)._replace(
            air=np.array([AIR, 0.0, 0.0, 0.0]),
            added_mass=np.full(1, air),
            wind_mean=np.array([[stream, 0.0, 0.0]]),
        )
        solver = Solver(model, Settings(tolerance=1e-6, newton=1e-10))
        state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        state = solver.equilibrium(state, loads._replace(gravity=np.array([0.0, 0.0, -0.1])))[0]
        step, tip = 0.025 / known[air], [state.points.nodes[0, -1, 0, 2]]
        for _ in range(120):
            state, report = solver.step(state, loads, hold_roots(state), step)
            assert report.status[0] == 0
            tip.append(state.points.nodes[0, -1, 0, 2])
        way = np.array(tip)
        before = np.flatnonzero(np.diff(np.sign(way)))
        zero = (before + way[before] / (way[before] - way[before + 1])) * step
        found[air, stream] = 0.5 / np.diff(zero).mean(), np.abs(way[100:]).max()
    still, swept = found[1.0, 0.0], found[1.0, speed]
    assert still[0] / found[0.0, 0.0][0] == pytest.approx(known[1.0] / known[0.0], rel=1e-3)
    assert swept[1] <= still[1] * (1.0 + 1e-3)


def pressed(aspect, angle, across=1.0):
    """C_N of a plate with attached flow in a stream across its shaft, or in part along it."""
    kind = plate(0.5 * LENGTH / aspect, attached=0.83)
    model = make_model([build_feather(kind, 21, 3)], [kind], 1)
    turn, along = np.radians(angle), np.sqrt(1.0 - across**2)
    flow = np.array([along * np.cos(turn), -across * np.cos(turn), np.sin(turn)])
    return stream_coefficients(model, 10.0 * flow)[2]


@pytest.mark.parametrize("aspect", [2.0, 4.0, 8.0])
def test_flow_presses_on_a_plate_as_measured(aspect):
    """At small angles the slope of Helmbold 1942; from 30 degrees the fit to plates of Lindenburg
    2003, ECN-C--03-025."""
    slope = 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect**2 + 4.0))
    assert pressed(aspect, 3.0) == pytest.approx(slope * np.radians(3.0), rel=0.05)
    assert pressed(aspect, 10.0) == pytest.approx(slope * np.radians(10.0), rel=0.1)
    for angle in (30.0, 60.0, 90.0):
        sine, finite = np.sin(np.radians(angle)), 0.41 * (1.0 - np.exp(-17.0 / aspect))
        expected = 1.98 * sine * (1.0 / (0.56 + 0.44 * sine) - finite)
        assert pressed(aspect, angle) == pytest.approx(expected, rel=0.1)
        assert pressed(aspect, -angle) == pytest.approx(-pressed(aspect, angle))


def test_flow_presses_on_a_plate_of_aspect_two_as_measured():
    """Lift and drag of Pelletier and Mueller 2000 at a Reynolds number of 1.4e5."""
    measured = ((6, 0.3, 0.03), (8, 0.4, 0.06), (10, 0.5, 0.08), (15, 0.7, 0.18), (20, 0.75, 0.28))
    for angle, lift, drag in measured:
        turn = np.radians(angle)
        expected = lift * np.cos(turn) + drag * np.sin(turn)
        assert pressed(2.0, angle) == pytest.approx(expected, rel=0.1)


def test_a_stream_along_the_shaft_lifts_nothing():
    sine = np.sin(np.radians(5.0))
    assert pressed(4.0, 5.0, across=0.0) == pytest.approx(1.2 * sine**2, rel=0.05)
