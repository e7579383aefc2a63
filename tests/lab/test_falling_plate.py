"""A plate that falls broadside in still air."""

import numpy as np
import pytest

from featherfx.feather.build import build_feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state

pytestmark = pytest.mark.verification

LENGTH, WIDTH, DENSITY = 0.2, 0.04, 0.5
AIR, NORMAL, GRAVITY = 1.2, 1.2, 9.81


def plate():
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
    )
    shaft = RachisMaterial(
        youngs_modulus=5e11,
        shear_modulus=1.5e11,
        cortex_fraction=1.0,
        cortex_density=1.0,
        core_density=1.0,
        loss_factor=0.2,
    )
    width = WIDTH / LENGTH
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


def test_terminal_speed_is_the_balance_of_weight_and_quadratic_drag():
    """m g = 1/2 rho S C v^2, and the way there: v = v_t tanh(g t / v_t)."""
    kind = plate()
    feather = build_feather(kind, 9, 3)
    model = make_model([feather], [kind], 1)._replace(held=np.zeros(1, dtype=np.bool_))
    rest = model.cell_rest[0][feather.cell]
    area = float(np.sum(0.5 / (rest[:, 0] * rest[:, 2])))
    assert area == pytest.approx(2 * WIDTH * LENGTH, rel=1e-9)
    loads = no_loads(1, (0.0, 0.0, -GRAVITY))._replace(air=np.array([AIR, NORMAL, 0.02, 0.0]))
    solver = Solver(model, Settings(tolerance=1e-5, newton=1e-9))
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    mass = model.mass[0]
    terminal = np.sqrt(2.0 * mass.sum() * GRAVITY / (AIR * area * NORMAL))
    interval = 0.2 * terminal / GRAVITY
    for k in range(1, 26):
        state, report = solver.step(state, loads, hold_roots(state), interval)
        assert report.status[0] == 0
        rates = state.velocity.nodes[0]
        mean = np.einsum("np,npk->k", mass, rates) / mass.sum()
        expected = terminal * np.tanh(0.2 * k)
        assert mean == pytest.approx([0.0, 0.0, -expected], abs=0.01 * terminal)
    assert -mean[2] == pytest.approx(terminal, rel=2e-3)
