"""Traction of vane samples: closed forms, meshes, limits, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from featherfx.errors import InputError
from featherfx.lab.vane.sample import (
    Moduli,
    Sample,
    aligned_of_size,
    areas,
    graded_rows,
    isotropic,
    membrane,
    unaligned_of_size,
)
from featherfx.lab.vane.statics import Statics
from featherfx.lab.vane.traction import Traction, clamped, pull_test, run_traction

SWAN = Moduli(3.6e8, 4.8e4, 2.8e4)
STIFF = Moduli(4.8e8, 4.8e4, 2.8e4)
SIZE = (13e-3, 18e-3)


def slope_of(angle, elements=1000, moduli=SWAN, strain=0.02, size=SIZE, **options):
    return pull_test(Traction(Sample(angle, *size), moduli, strain, 2, elements, **options)).slope


@pytest.mark.verification
@pytest.mark.parametrize(("angle", "modulus"), [(0.0, SWAN.across), (90.0, SWAN.along)])
def test_closed_forms(angle, modulus):
    """Barbs along x or y: the sample deforms evenly, stress = modulus * strain."""
    found = run_traction(Traction(Sample(angle, *SIZE), SWAN, 0.2, 3, 500))
    assert found.slope == pytest.approx(modulus, rel=1e-8)
    assert found.stress == pytest.approx(modulus * found.strain, rel=1e-8)


@pytest.mark.verification
def test_isotropic_samples_do_not_know_their_angle():
    """Without Poisson effect an isotropic sample deforms evenly, whatever the mesh's direction."""
    for angle in (0.0, 20.0, 45.0, 90.0):
        assert slope_of(angle, model="isotropic") == pytest.approx(SWAN.across, rel=1e-8)
    assert slope_of(33.0, moduli=isotropic(1e5), mesh="unaligned") == pytest.approx(1e5, rel=1e-8)


def test_mirrored_barbs_pull_alike():
    assert slope_of(-30.0) == pytest.approx(slope_of(30.0), rel=2e-3)


@pytest.mark.parametrize("angle", [0.0, 1.0, 30.0, 45.0, 54.1, 70.0, 90.0, -20.0])
def test_aligned_meshes_fill_the_sample(angle):
    sample = Sample(angle, *SIZE)
    mesh = aligned_of_size(sample, 700, 0.01)
    assert len(mesh.triangles) == pytest.approx(700, rel=0.1)
    assert areas(mesh).min() > 0.0
    assert areas(mesh).sum() == pytest.approx(SIZE[0] * SIZE[1], rel=1e-8)
    # every triangle has an edge along the barbs
    corner = mesh.points[mesh.triangles]
    offsets = (np.roll(corner, -1, axis=1) - corner) @ sample.across
    assert np.abs(offsets).min(axis=1).max() < 1e-12


def test_rows_pass_through_all_corners():
    sample = Sample(37.0, *SIZE)
    corners = np.array([[0, 0], [SIZE[0], 0], [0, SIZE[1]], SIZE]) @ sample.across
    rows = graded_rows(sample, 40, 0.01)
    assert np.abs(rows[:, None] - corners).min(axis=0).max() < 1e-15
    assert np.all(np.diff(rows) > 0.0)


def test_unaligned_meshes_fill_the_sample():
    mesh = unaligned_of_size(Sample(45.0, *SIZE), 700)
    assert areas(mesh).min() > 0.0
    assert areas(mesh).sum() == pytest.approx(SIZE[0] * SIZE[1], rel=1e-12)
    assert len(mesh.chains) == 0


@pytest.mark.parametrize(("order", "guard"), [(1, 0.0), (2, 0.0), (1, 1e9)])
def test_forces_are_the_energy_gradient(order, guard):
    sample, moduli = Sample(30.0, *SIZE), isotropic(1e5).as_array()
    body = membrane(sample, aligned_of_size(sample, 40, 1.0), moduli, order, guard=guard)
    statics = Statics(body, np.zeros(len(body.points), dtype=bool))
    bent = body.points * [1.05, 0.97] + 0.1 * np.sin(300.0 * body.points[:, ::-1]) * 1e-3
    pose = statics.rest()
    forces = statics.forces(type(pose)(bent, pose.stresses, pose.tensions))
    checked = approx_fprime(
        bent.ravel(), lambda each: statics.system.energy(each.reshape(-1, 2)), 1e-9
    ).reshape(-1, 2)
    assert forces == pytest.approx(checked, abs=1e-4 * np.abs(checked).max())


def test_stiffness_is_the_slope_of_the_forces():
    """Of a pose pressed to 0.6 of its area, where the guard is most of it."""
    sample, moduli = Sample(30.0, *SIZE), isotropic(1e5).as_array()
    body = membrane(sample, aligned_of_size(sample, 40, 1.0), moduli, guard=1e9)
    system = Statics(body, np.zeros(len(body.points), dtype=bool)).system
    pose = body.points * [0.8, 0.75] + 0.05 * np.sin(300.0 * body.points[:, ::-1]) * 1e-3
    _, _, values = system.assembled(pose, system.stresses(pose))
    move = np.random.default_rng(1).normal(size=pose.shape)
    sides = [system.assembled(pose + h * move, system.stresses(pose))[1] for h in (1e-8, -1e-8)]
    checked = (sides[0] - sides[1]).ravel() / 2e-8
    found = system.matrix(values) @ move.ravel()
    assert found == pytest.approx(checked, abs=1e-5 * np.abs(checked).max())


def test_barbs_that_slide_upon_each_other_are_held_apart():
    """At 75 degrees barbs join the clamps; in two corners others slide until they lie upon them."""
    test = Traction(Sample(75.0, 10e-3, 30e-3), SWAN, 0.04, 8, 4000)
    with pytest.raises(InputError, match=r"at 0.04: .*guard keeps.*There is one up to 0.035"):
        pull_test(test)
    held = pull_test(replace(test, guard=1e9))
    before = pull_test(replace(test, strain=0.035, steps=7))
    assert held.stress[:7] == pytest.approx(before.stress, rel=0.015)
    assert np.diff(held.stress, 2).min() > 0.0


def test_rigid_motion_costs_nothing():
    sample = Sample(30.0, *SIZE)
    body = membrane(sample, aligned_of_size(sample, 200, 0.1), SWAN.as_array(), 2)
    statics = Statics(body, clamped(sample, body))
    turned = body.points @ np.array([[0.6, 0.8], [-0.8, 0.6]]) + [0.3, -0.1]
    soft = SWAN.across * sample.thickness * sample.width * sample.height
    assert statics.system.energy(turned) < 1e-15 * SWAN.along / SWAN.across * soft


@pytest.mark.verification
@pytest.mark.parametrize(("angle", "allowed"), [(15.0, 0.01), (45.0, 0.02)])
def test_slopes_converge(angle, allowed):
    """2,000 elements are within what is promised for 8,000; ratio of moduli 1e4."""
    coarse, fine = (slope_of(angle, count, STIFF, 1e-3) for count in (2000, 12000))
    assert coarse == pytest.approx(fine, rel=allowed)


@pytest.mark.slow
@pytest.mark.verification
@pytest.mark.parametrize("angle", [45.0, 50.0, 53.0, 54.1])
def test_slopes_converge_up_to_the_bridging_angle(angle):
    coarse, fine = (slope_of(angle, count, STIFF, 1e-3) for count in (8000, 60000))
    assert coarse == pytest.approx(fine, rel=0.02)


def test_aligned_meshes_do_not_lock():
    """600 elements at a ratio of 1e4: within 5 % where aligned, many times too stiff where not."""
    fine = slope_of(45.0, 6000, STIFF, 1e-5)
    assert slope_of(45.0, 600, STIFF, 1e-5) == pytest.approx(fine, rel=0.05)
    assert slope_of(45.0, 600, STIFF, 1e-5, mesh="unaligned") > 10.0 * fine


def test_inextensible_limit():
    """Barbs keep their length, and the finite ratio tends to the limit as it grows."""
    sample = Sample(45.0, *SIZE)
    test = Traction(sample, SWAN, 0.05, 2, 1000, model="inextensible")
    limit = pull_test(test)
    chains = limit.statics.membrane.chains
    lengths = [
        np.linalg.norm(np.diff(points[chains], axis=1), axis=-1)
        for points in (limit.pose.positions, limit.statics.membrane.points)
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-10)
    off = [
        abs(slope_of(45.0, 1000, Moduli(ratio * 4.8e4, 4.8e4, 2.8e4), 0.05) / limit.slope - 1.0)
        for ratio in (1e2, 1e4, 1e6)
    ]
    assert off[0] > 0.1 > 0.05 > off[1] > off[2]
    assert off[2] < 0.01


def test_joined_clamps_are_said():
    square = Sample(45.0, 0.01, 0.01)
    for sample, regime, word in (
        (square, "diagonal", "singular"),
        (Sample(70.0, *SIZE), "bridged", "barbs join both clamps"),
    ):
        found = run_traction(Traction(sample, SWAN, 0.01, 1, 1000))
        assert (found.regime, word in found.note) == (regime, True)
        assert (found.slope is None) == (regime == "diagonal")
    taut = run_traction(Traction(square, SWAN, 0.01, 1, 1000, model="inextensible"))
    assert taut.slope is None
    assert "constant length" in taut.note
    assert slope_of(70.0) > 0.1 * SWAN.along


def test_a_number_of_the_mesh_is_not_given():
    found = run_traction(Traction(Sample(45.0, *SIZE), STIFF, 1e-4, 1, 400, mesh="unaligned"))
    assert found.slope is None
    assert found.stress is None
    assert abs(found.mesh_change) > 0.1
    assert "mesh" in found.note


def test_all_problems_are_told():
    wrong = Traction(
        Sample(95.0, 0.0, 18.0, 120.0),
        Moduli(-1.0, 0.0, np.nan),
        -0.5,
        0,
        5,
        "unaligned",
        "inextensible",
    )
    with pytest.raises(InputError) as error:
        run_traction(wrong)
    keys = {problem.key for problem in error.value.problems}
    assert keys == {
        *("angle", "width", "height", "thickness", "along", "across", "shear"),
        *("strain", "steps", "elements", "mesh"),
    }
    assert "micrometres" in str(error.value)


def test_a_corner_that_closes_is_named_with_the_strain_that_it_bears():
    """A moved clamp turned triangles over, and no step may begin with any that are: so none was
    taken, until the limit of iterations, and only that was told."""
    test = Traction(Sample(75.0, 0.01, 0.03), SWAN, 0.08, 4, 600)
    with pytest.raises(InputError, match=r"turned over, the most at x 0.1\d+, y 3.\d+ mm .* 0.06"):
        run_traction(test)
    assert len(run_traction(replace(test, strain=0.06, steps=3)).strain) == 3


def test_crushed_samples_are_refused():
    with pytest.raises(InputError, match="no equilibrium"):
        run_traction(Traction(Sample(45.0, *SIZE), SWAN, -0.49, 2, 200))
