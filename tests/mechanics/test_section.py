"""Shaft sections against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.groom.materials import RachisMaterial
from featherfx.mechanics.resolution import rachis_mass, rachis_stiffness

SOLID = RachisMaterial(
    youngs_modulus=5e9,
    shear_modulus=2e9,
    cortex_fraction=1.0,
    flattening=1.0,
    cortex_density=1300.0,
    core_density=100.0,
    loss_factor=0.0,
)
WIDTH, HEIGHT = np.array([4e-3, 1e-3]), np.array([4e-3, 0.5e-3])


def test_solid_circle():
    radius = 2e-3
    stretch, bend = rachis_stiffness(WIDTH[:1], HEIGHT[:1], SOLID)
    area, moment = np.pi * radius**2, np.pi / 4 * radius**4
    assert stretch[0] == pytest.approx([5e9 * area, 2e9 * 0.9 * area, 2e9 * 0.9 * area])
    assert bend[0] == pytest.approx([2e9 * 2 * moment, 5e9 * moment, 5e9 * moment])


def test_torsion_and_bending_of_a_solid_ellipse():
    _, bend = rachis_stiffness(WIDTH[1:], HEIGHT[1:], SOLID)
    a, b = 0.5e-3, 0.25e-3
    assert bend[0, 0] == pytest.approx(2e9 * np.pi * a**3 * b**3 / (a**2 + b**2))
    # bending about d2, the wide axis, is out of the vane: the height counts to the third power
    assert bend[0, 1] == pytest.approx(5e9 * np.pi / 4 * a * b**3)
    assert bend[0, 2] == pytest.approx(5e9 * np.pi / 4 * b * a**3)


def test_torsion_of_an_ellipse_by_its_stress_function():
    """J = 2 times the integral of p with laplace(p) = -2, p = 0 on the boundary, on a grid."""
    a, b, count = 1.0, 0.5, 120
    x, y = np.meshgrid(np.linspace(-a, a, 2 * count), np.linspace(-b, b, count), indexing="ij")
    step = (x[1, 0] - x[0, 0], y[0, 1] - y[0, 0])
    inside = (x / a) ** 2 + (y / b) ** 2 < 1.0
    from scipy.sparse import diags_array, eye_array, kron
    from scipy.sparse.linalg import spsolve

    lines = [
        diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)) / h**2
        for n, h in zip(x.shape, step, strict=True)
    ]
    laplace = kron(lines[0], eye_array(count)) + kron(eye_array(2 * count), lines[1])
    laplace = laplace.tocsr()[inside.ravel()][:, inside.ravel()]
    numeric = 2.0 * spsolve(laplace.tocsc(), -2.0 * np.ones(inside.sum())).sum() * step[0] * step[1]
    unit = replace(SOLID, shear_modulus=1.0)
    _, bend = rachis_stiffness(np.array([2 * a]), np.array([2 * b]), unit)
    assert bend[0, 0] == pytest.approx(numeric, rel=0.03)


@pytest.mark.parametrize("wall", [0.05, 0.2, 0.6])
def test_a_tube_is_the_solid_shaft_without_its_core(wall):
    hollow = replace(SOLID, cortex_fraction=wall)
    core = 1.0 - wall
    outer_stretch, outer_bend = rachis_stiffness(WIDTH, HEIGHT, SOLID)
    inner_stretch, inner_bend = rachis_stiffness(core * WIDTH, core * HEIGHT, SOLID)
    stretch, bend = rachis_stiffness(WIDTH, HEIGHT, hollow)
    assert bend == pytest.approx(outer_bend - inner_bend, rel=1e-12)
    assert stretch[:, 0] == pytest.approx(outer_stretch[:, 0] - inner_stretch[:, 0], rel=1e-12)


def test_a_thin_tube():
    radius, wall = 2e-3, 1e-3
    material = replace(SOLID, cortex_fraction=wall)
    stretch, bend = rachis_stiffness(np.array([2 * radius]), np.array([2 * radius]), material)
    thickness = wall * radius
    assert stretch[0, 0] == pytest.approx(5e9 * 2 * np.pi * radius * thickness, rel=2 * wall)
    assert stretch[0, 1] == pytest.approx(0.5 * stretch[0, 0] * 2 / 5, rel=2 * wall)
    assert bend[0, 1] == pytest.approx(5e9 * np.pi * radius**3 * thickness, rel=2 * wall)


def test_mass_of_cortex_and_core():
    material = replace(SOLID, cortex_fraction=0.25)
    line, about_second, about_third = rachis_mass(WIDTH, HEIGHT, material)
    outer = np.pi / 4 * WIDTH * HEIGHT
    inner = 0.75**2 * outer
    assert line == pytest.approx(1300.0 * (outer - inner) + 100.0 * inner, rel=1e-12)
    # a uniform section: the radii of gyration are a quarter of width and height
    line, about_second, about_third = rachis_mass(
        WIDTH, HEIGHT, replace(SOLID, core_density=1300.0)
    )
    assert about_second == pytest.approx(line * (HEIGHT / 4) ** 2, rel=1e-12)
    assert about_third == pytest.approx(line * (WIDTH / 4) ** 2, rel=1e-12)
