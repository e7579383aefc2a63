"""Thickness and moduli that change along shaft and barbs: cantilevers, and models of even ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feather_kinds import LEADING_VANE, NO_VANE, SWAN_PRIMARY, TRAILING_VANE, feather_kind
from scipy.integrate import quad
from trial_batches import assembled, at_origin, random_pose

from featherfx.feather.build import build_feather
from featherfx.feather.types import scale_feather
from featherfx.groom.materials import Profile
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.mechanics.batch import make_model, resized
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.resolution import barb_course, barb_deflection, rachis_deflection
from featherfx.mechanics.vane_rest import curvature_shapes
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.types import IntegratorFactors

FALLING = ((0.0, 1.5), (0.6, 0.9), (1.0, 0.25))
# a thousandth of what it is for, so that deflections are small
PULL = 1e-5


def with_vane(kind, **changes):
    return replace(kind, vane_material=replace(kind.vane_material, **changes))


def with_shaft(kind, **changes):
    return replace(kind, rachis_material=replace(kind.rachis_material, **changes))


def constants(kind, rows=9):
    return make_model([build_feather(kind, rows, 4)], [kind], 3)


def assert_same(found, wanted):
    for name, values in wanted.arrays().items():
        if values.dtype == float:
            own, values = (np.nan_to_num(x, posinf=-1.0) for x in (found.arrays()[name], values))
            scale = np.abs(values).max(initial=0.0)
            assert np.abs(own - values).max(initial=0.0) <= 1e-12 * scale, name


def profile(value):
    return Profile(((0.0, value), (1.0, value)), ((0.3, value),))


def test_factors_of_one_change_nothing_to_the_last_bit():
    even = replace(SWAN_PRIMARY.rachis, diameter_profile=((0.0, 1.0), (1.0, 1.0)))
    ones = {
        f"{name}_profile": profile(1.0) for name in ("thickness", "across_barbs", "along_barbs")
    }
    kind = with_shaft(replace(SWAN_PRIMARY, rachis=even), modulus_profile=((0.5, 1.0),))
    found, plain = constants(with_vane(kind, **ones)).arrays(), constants(SWAN_PRIMARY).arrays()
    assert all(values.tobytes() == plain[name].tobytes() for name, values in found.items())


@pytest.mark.parametrize(
    ("profile_of", "powers"),
    [
        (
            "across_barbs_profile",
            {"modulus_across_barbs": 1, "shear_modulus": 1, "bending_across": 1},
        ),
        ("along_barbs_profile", {"barb_bending_normal": 1, "barb_bending_in_plane": 1}),
        (
            "thickness_profile",
            {
                **{"thickness": 1, "surface_density": 1, "bending_across": 3},
                **{"barb_bending_normal": 3, "barb_bending_in_plane": 3},
            },
        ),
    ],
)
def test_factors_that_are_even_stand_for_other_figures(profile_of, powers):
    base = with_vane(SWAN_PRIMARY, compression_guard=1e5)
    by_shaft = with_vane(base, **{profile_of: Profile(rachis=((0.0, 2.5),))})
    figures = {n: getattr(base.vane_material, n) * 2.5**power for n, power in powers.items()}
    assert_same(constants(by_shaft), constants(with_vane(base, **figures)))


def test_an_even_factor_along_barbs_stands_in_their_shapes():
    """1/2 B / L q^2 of shapes that are orthonormal under b: with b times four, q is twice as large
    for the same curvature."""
    found = constants(with_vane(SWAN_PRIMARY, along_barbs_profile=Profile(barb=((0.0, 4.0),))))
    assert_same(found._replace(shapes=2.0 * found.shapes), constants(SWAN_PRIMARY))


def test_even_factors_of_the_shaft_stand_for_its_figures():
    stiff = with_shaft(SWAN_PRIMARY, modulus_profile=((0.2, 3.0),))
    young, shear = (
        SWAN_PRIMARY.rachis_material.youngs_modulus,
        SWAN_PRIMARY.rachis_material.shear_modulus,
    )
    wanted = with_shaft(SWAN_PRIMARY, youngs_modulus=3.0 * young, shear_modulus=3.0 * shear)
    assert_same(constants(stiff), constants(wanted))
    shape = SWAN_PRIMARY.rachis
    thick = {"diameter_base": 2.0 * shape.diameter_base, "diameter_tip": 2.0 * shape.diameter_tip}
    found = replace(SWAN_PRIMARY, rachis=replace(shape, diameter_profile=((0.0, 2.0),)))
    assert_same(constants(found), constants(replace(SWAN_PRIMARY, rachis=replace(shape, **thick))))


def straight_shaft(modulus=(), diameter=()):
    """A straight round shaft of even diameter without vanes."""
    kind = feather_kind(NO_VANE, NO_VANE, calamus=0.0, camber=0.0, sweep=0.0, twist=0.0)
    shape = replace(kind.rachis, diameter_tip=0.006, diameter_profile=diameter)
    shaft = replace(kind.rachis_material, modulus_profile=modulus, flattening=1.0)
    return replace(kind, rachis=shape, rachis_material=shaft)


def sag(kind, rows):
    """m, how far a dorsal force PULL at the tip moves it."""
    model = make_model([build_feather(kind, rows, 1)], [kind], 0)
    force = np.zeros((1, rows, 3, 3))
    force[0, -1, 0, 2] = PULL
    with Solver(model, Settings(newton=1e-11)) as solver:
        settled, status, _ = solver.equilibrium(at_origin(model), no_loads(1)._replace(force=force))
    assert status[0] == 0
    return settled.points.nodes[0, -1, 0, 2]


@pytest.mark.parametrize(
    ("curves", "factor"),
    [
        # the modulus falls to a tenth
        ({"modulus": ((0.0, 1.0), (1.0, 0.1))}, lambda s: (1.0 - 0.9 * s, 1.0 - 0.9 * s)),
        # the diameter falls to 60 %
        (
            {"diameter": ((0.0, 1.0), (1.0, 0.6))},
            lambda s: ((1.0 - 0.4 * s) ** 4, (1.0 - 0.4 * s) ** 2),
        ),
    ],
)
def test_a_cantilever_sags_as_the_integral_says(curves, factor):
    """The tip goes by the integral of P (L - x)^2 / EI(x) + P / GA(x)."""
    kind = straight_shaft(**curves)
    wall, area = kind.rachis_material.cortex_fraction, np.pi / 4 * 0.006**2
    bending = (
        kind.rachis_material.youngs_modulus * np.pi / 64 * 0.006**4 * (1.0 - (1.0 - wall) ** 4)
    )
    shear = (
        kind.rachis_material.shear_modulus * area * (1.0 - (1.0 - wall) ** 2) * (0.5 + 0.4 * wall)
    )
    bent, _ = quad(lambda s: (1.0 - s) ** 2 / factor(s)[0], 0.0, 1.0)
    sheared, _ = quad(lambda s: 1.0 / factor(s)[1], 0.0, 1.0)
    expected = PULL * (kind.length**3 / bending * bent + kind.length / shear * sheared)
    assert bent > 1.2 / 3.0
    errors = [abs(sag(kind, rows) / expected - 1.0) for rows in (11, 21, 41)]
    assert errors[2] < 1e-3
    # of second order
    assert errors[2] < 0.3 * errors[1] < 0.1 * errors[0]


def test_a_barb_whose_stiffness_falls_bends_as_the_integral_says():
    """Under an even load its end goes by the integral of q L^4 / B (1 - s)^3 / (2 b(s))."""

    def falling(s):
        return np.interp(s, *np.transpose(FALLING))

    segments = 24
    shapes = curvature_shapes(1, segments, 0.0, falling)
    heights = np.cumsum(np.cumsum(shapes[0])) / segments
    # the end of a barb of small q, under weights of trapezoids
    weights = np.full(segments, 1.0 / segments)
    weights[-1] *= 0.5
    found = (weights @ heights) * heights[-1]
    expected, _ = quad(lambda s: (1.0 - s) ** 3 / (2.0 * falling(s)), 0.0, 1.0, points=[0.6])
    assert found == pytest.approx(expected, rel=5e-3)
    even = (np.cumsum(np.cumsum(curvature_shapes(1, segments, 0.0)[0])) / segments)[-1]
    assert abs(even / heights[-1] - 1.0) > 0.05


def uneven():
    """The swan's primary with all profiles."""
    kind = with_vane(
        feather_kind(LEADING_VANE, TRAILING_VANE),
        thickness_profile=Profile(FALLING, ((0.0, 1.0), (1.0, 0.6))),
        across_barbs_profile=Profile(((0.0, 0.5), (1.0, 2.0)), FALLING),
        along_barbs_profile=Profile(FALLING, FALLING),
    )
    shape = replace(kind.rachis, diameter_profile=FALLING)
    return with_shaft(replace(kind, rachis=shape), modulus_profile=((0.1, 2.0), (0.9, 0.4)))


def test_forces_are_the_slope_of_the_energy_of_an_uneven_feather():
    model, loads, still = constants(uneven()), no_loads(1), IntegratorFactors(0.0, 0.0, 0.0)
    state = random_pose(model, np.random.default_rng(3), 0.02, 0.05)
    work = make_scratch(model)

    def energy(of):
        load_pose(model, 0, of, work.now)
        return evaluate(model, loads, 0, 0.0, still, work.now, work.around)

    base = energy(state)
    slope = assembled(model, loads, 0.0, still, work)
    other = state.copy()
    ends = []
    for sign in (-1.0, 1.0):
        other.coefficient[...] = state.coefficient
        other.coefficient[0, 0, 5, 1] += sign * 1e-3
        ends.append(energy(other))
    found = (ends[1] - ends[0]) / 2e-3
    # rows of 18 unknowns, frame and place first
    assert base > 0.0
    assert slope[5 * 18 + 6 + 1] == pytest.approx(found, rel=1e-5)


def test_uneven_feathers_of_other_sizes_follow_from_one():
    unit, size = uneven(), 2.5
    built = build_feather(unit, 9, 4)
    kind = adjusted(unit, Change(scale=size))
    wanted = make_model([scale_feather(built, size)], [kind], 2)
    assert_same(resized(make_model([built], [unit], 2), np.array([size])), wanted)


def test_weaker_ends_are_reckoned_with_in_the_choice_of_the_grid():
    weak = with_vane(SWAN_PRIMARY, along_barbs_profile=Profile(barb=((0.0, 1.0), (1.0, 0.1))))
    soft = with_shaft(SWAN_PRIMARY, modulus_profile=((0.0, 1.0), (1.0, 0.1)))
    feather = build_feather(SWAN_PRIMARY, 21, 4)
    barbs = [barb_deflection(feather, each, 0.1) for each in (SWAN_PRIMARY, weak)]
    shafts = [rachis_deflection(feather, each, 9.81, 0.1) for each in (SWAN_PRIMARY, soft)]
    assert barbs[1] > 1.2 * barbs[0]
    assert shafts[1] > 1.2 * shafts[0]


def test_feathers_whose_barbs_change_otherwise_share_no_batch():
    even = SWAN_PRIMARY
    assert barb_course(even) == barb_course(with_shaft(even, modulus_profile=FALLING))
    assert barb_course(even) == barb_course(with_vane(even, along_barbs_profile=Profile(FALLING)))
    for name in ("along_barbs_profile", "thickness_profile"):
        assert barb_course(with_vane(even, **{name: Profile(barb=FALLING)})) != barb_course(even)
