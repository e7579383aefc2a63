"""Constants of a batch: rest strains, masses, areas, stiffnesses of the shipped feathers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_cases import draw_case
from trial_batches import FEATHER_PRESETS, at_origin, preset_batch, preset_kind

from featherfx.feather.build import build_feather
from featherfx.feather.profiles import hooked_stiffness
from featherfx.feather.types import RACHIS_PART, scale_feather
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import BarbGuide, VaneShape
from featherfx.lab.strip import strip_feather, strip_kind
from featherfx.mechanics.batch import MIN_HOOKED, make_model, resized, row_frames
from featherfx.mechanics.model import expand_wind, no_loads
from featherfx.mechanics.vane_bending_kernels import hinge_angle
from featherfx.mechanics.vane_rest import cell_weights
from featherfx.solver.damping import with_damping
from featherfx.solver.scratch import make_scratch
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.types import IntegratorFactors


def strains_of(model, state):
    """Strains of the first feather, one after the other; its hinges are open."""
    work = make_scratch(model)
    load_pose(model, 0, state, work.now)
    evaluate(
        model,
        no_loads(model.feathers),
        0,
        0.0,
        IntegratorFactors(0.0, 0.0, 0.0),
        work.now,
        work.around,
    )
    np.testing.assert_array_equal(work.now.strains.openness, 1.0)
    return np.concatenate([each.ravel() for each in work.now.strains[:-1]])


def vane_area(feather):
    """Area of the vanes as the surface draws them."""
    surface = feather.surface
    corners = surface.points(feather.rest)[surface.triangles[surface.part != RACHIS_PART]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * np.linalg.norm(normal, axis=1).sum()


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_the_rest_shape_is_the_feather_and_has_no_strain(name, mirrored):
    feather, model = preset_batch(name, 13, 5, mirrored=mirrored)
    state = at_origin(model)
    size = np.ptp(feather.rest.nodes[:, 0], axis=0).max()
    for part, rest in zip(state.points.at(0), feather.rest, strict=True):
        assert np.abs(part - rest).max() < 1e-12 * size
    assert np.abs(strains_of(model, state)).max() < 1e-10


@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_rest_strains_are_those_of_the_rest_shape_only(name):
    """The same feather under another's constants is strained: the zero above is no accident."""
    _, model = preset_batch(name, 13, 5)
    bent = model._replace(rachis_rest=model.rachis_rest.copy())
    bent.rachis_rest[..., 4] += 0.1
    assert np.abs(strains_of(model, at_origin(bent))).max() > 0.05


@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_mass_is_shaft_plus_vane(name):
    feather, model = preset_batch(name, 21, 6)
    kind = preset_kind(name)
    shaft, core = kind.rachis_material, 1.0 - kind.rachis_material.cortex_fraction
    density = shaft.cortex_density * (1 - core**2) + shaft.core_density * core**2
    line = density * np.pi / 4 * feather.width * feather.height
    station = np.concatenate([[0.0], np.cumsum(model.length[0])])
    expected = np.trapezoid(line, station)
    expected += kind.vane_material.surface_density * vane_area(feather)
    assert model.mass[0].sum() == pytest.approx(expected, rel=1e-12)
    assert (model.mass >= 0.0).all()
    assert (model.mass[0, :, 0] > 0.0).all()
    assert (model.rotary_inertia > 0.0).all()


def test_shaft_mass_converges_to_the_integral_of_the_taper():
    kind = preset_kind("swan_primary")
    shape, shaft = kind.rachis, kind.rachis_material
    s = np.linspace(0.0, 1.0, 20001)
    taper = (1.0 - s) ** shape.taper
    diameter = shape.diameter_tip + (shape.diameter_base - shape.diameter_tip) * taper
    core = 1.0 - shaft.cortex_fraction
    density = shaft.cortex_density * (1 - core**2) + shaft.core_density * core**2
    area = np.pi / 4 * diameter**2 * shaft.flattening
    exact = density * kind.length * np.trapezoid(area, s)
    bare = replace(kind, vane_material=replace(kind.vane_material, surface_density=0.0))
    errors = []
    for rows in (11, 21, 41):
        model = make_model([build_feather(bare, rows, 2)], [bare], 1)
        errors.append(abs(model.mass[0].sum() / exact - 1.0))
    assert errors[0] < 0.02
    assert errors[2] < 0.3 * errors[1] < 0.1 * errors[0]


@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_cells_cover_the_vane(name):
    feather, model = preset_batch(name, 21, 6)
    vane = preset_kind(name).vane_material
    share = hooked_stiffness(preset_kind(name), feather) * (not vane.ribbon)
    held = np.maximum(share, MIN_HOOKED)[..., None] * cell_weights(6)
    area = (
        model.cell_stiffness[0]
        / vane.thickness
        / np.array([vane.modulus_across_barbs, vane.shear_modulus])
        / held
    )
    assert area[..., 0].sum() == pytest.approx(vane_area(feather), rel=1e-12)
    assert area[..., 1] == pytest.approx(area[..., 0], rel=1e-12)
    assert ((area[..., 0] > 0.0) == feather.cell).all()


def test_equal_feathers_have_equal_constants_and_others_do_not():
    names = ["swan_primary", "swan_secondary", "swan_primary"]
    kinds = [
        replace(preset_kind(n), vane_material=preset_kind(names[0]).vane_material) for n in names
    ]
    model = make_model([build_feather(kind, 9, 4) for kind in kinds], kinds, 2)
    assert model.mass[0].tobytes() == model.mass[2].tobytes()
    assert model.mass[0].tobytes() != model.mass[1].tobytes()
    assert model.feathers == 3


def test_row_frames_are_rotations():
    feather, _ = preset_batch("swan_primary", 21, 6)
    frames = row_frames(feather.rest.directors)
    assert frames @ frames.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (21, 1, 1)))
    assert np.linalg.det(frames) == pytest.approx(np.ones(21))
    assert frames[0] == pytest.approx(np.eye(3), abs=1e-12)


def flat_kind(angle):
    """A flat feather of even width with parallel barbs at an angle (deg) to a straight rachis."""
    kind = preset_kind("swan_primary")
    vane = VaneShape(((0.0, 0.15), (1.0, 0.15)), (BarbGuide(0.5, angle, 0.0, 0.0),))
    rachis = replace(kind.rachis, camber=0.0, sweep=0.0, twist=0.0)
    return replace(kind, rachis=rachis, leading=vane, trailing=vane)


@pytest.mark.parametrize("columns", [2, 3, 4, 6, 9])
def test_masses_of_a_barb_have_the_moments_of_an_even_one(columns):
    """Gregory's rule is exact up to cubes; of three nodes it is Simpson's, of four that of 3/8."""
    feather = strip_feather(0.1, 2.0, 3, columns)
    kind = strip_kind(0.1, preset_kind("swan_primary").vane_material)
    mass = make_model([feather], [kind], 0).mass[0]
    barb = mass[:, 1 + columns :].sum(axis=0)
    place = np.arange(1, columns + 1) / columns
    even = 0.1 * kind.vane_material.surface_density
    for power in (1, 2, 3):
        assert barb @ place**power == pytest.approx(even / (power + 1), rel=1e-12)
    assert mass.sum() == pytest.approx(2.0 * even, rel=1e-12)


@pytest.mark.parametrize("columns", [3, 4, 5, 9])
def test_shear_is_summed_over_the_middles_of_segments_exactly_up_to_cubes(columns):
    weights = cell_weights(columns)[..., 1].mean(axis=1) / columns
    middle = (np.arange(columns) + 0.5) / columns
    for power in range(4):
        assert weights @ middle**power == pytest.approx(1.0 / (power + 1), rel=1e-12)


def test_a_barb_has_no_more_coefficients_than_joints():
    _, model = preset_batch("swan_primary", rows=5, columns=2, coefficients=3)
    assert model.coefficients == 2


@pytest.mark.parametrize("seed", range(320036, 320048))
def test_no_node_has_less_than_no_mass_beside_the_widest_row(seed):
    assert (draw_case(seed, 40).model.mass >= 0.0).all()


@pytest.mark.parametrize("angle", [90.0, 45.0])
def test_a_vane_bent_to_a_cylinder_along_its_barbs_has_the_energy_of_a_plate(angle):
    kind = flat_kind(angle)
    feather = build_feather(kind, 41, 4)
    model = make_model([feather], [kind], 1)
    stiffness, radius = model.hinge_stiffness[0, 0], 0.5
    assert np.count_nonzero(stiffness) > 50
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    across = np.array([along[1], -along[0], 0.0])
    nodes = feather.rest.nodes[:, :5]
    turn = nodes @ across / radius
    bent = (nodes @ along)[..., None] * along + radius * np.sin(turn)[..., None] * across
    bent[..., 2] = radius * (1.0 - np.cos(turn))
    energy = area = 0.0
    for i, j in np.argwhere(stiffness > 0.0):
        corners = bent[i, j], bent[i, j + 1], bent[i + 1, j + 1], bent[i - 1, j + 1]
        change = hinge_angle(*corners) - model.hinge_rest[0, 0, i, j, 0]
        energy += 0.5 * stiffness[i, j] * change**2
        rest = nodes[i, j], nodes[i, j + 1], nodes[i + 1, j + 1], nodes[i - 1, j + 1]
        edge = rest[1] - rest[0]
        area += 0.5 * np.linalg.norm(np.cross(edge, rest[2] - rest[0]))
        area += 0.5 * np.linalg.norm(np.cross(edge, rest[3] - rest[0]))
    expected = 0.5 * kind.vane_material.bending_across / radius**2 * area
    assert energy == pytest.approx(expected, rel=2e-3)


def test_wind_of_all_feathers_lies_in_memory_as_that_of_each():
    """Else all kernels would be compiled anew for it."""
    of_all = expand_wind(no_loads(3)._replace(wind_mean=np.array([1.0, 2.0, 3.0])), 3)
    of_each = expand_wind(no_loads(3), 3)
    assert of_all.wind_mean.tolist() == [[1.0, 2.0, 3.0]] * 3
    for name, array in of_each._asdict().items():
        if isinstance(array, np.ndarray):
            found = getattr(of_all, name)
            assert (found.strides, found.flags.writeable) == (array.strides, True), name


def test_constants_of_similar_feathers_follow_from_their_size():
    """All of them: a field that grows with the size and is not said to would differ."""
    unit = preset_kind("swan_primary")
    vane = replace(unit.vane_material, compression_guard=1e5, barb_clamp_normal=2.0)
    unit = replace(unit, vane_material=vane)
    sizes = np.array([0.3, 1.0, 2.5])
    kinds = [adjusted(unit, Change(scale=size)) for size in sizes.tolist()]
    built = build_feather(unit, 9, 3, True)
    one = with_damping(make_model([built] * 3, [unit] * 3, 1), [unit] * 3)
    found = resized(one, sizes).arrays()
    feathers = [scale_feather(built, size) for size in sizes.tolist()]
    wanted = with_damping(make_model(feathers, kinds, 1), kinds).arrays()
    for name, values in wanted.items():
        own, same = (np.nan_to_num(x.astype(float), posinf=-1.0) for x in (values, found[name]))
        rows = tuple(range(1, max(values.ndim - 1, 1)))
        # of each component, which differ in their units, and rounding of what is none
        largest = np.abs(own).max(initial=0.0, axis=rows, keepdims=True)
        most = 1e-12 * largest + 1e-15 * np.abs(own).max(initial=0.0)
        assert (np.abs(same - own) <= most).all(), name
