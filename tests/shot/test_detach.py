"""Feathers that leave their roots: momenta without air, terminal speed with it."""

from dataclasses import replace

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot

GROOM = """
name = "moult"
[[feather]]
id = "held"
kind = "body_contour"
position = [0, 0, 0]
direction = [1, 0, 0]
up = [0, 0, 1]

[[feather]]
id = "falls"
kind = "body_contour"
position = [0, 0.2, 0]
direction = [1, 0, 0]
up = [0, 0, 1]
"""
SHOT = """
name = "moult"
groom = "groom.toml"
frames = [1, 18]
quality.base = "draft"
quality.coefficients = 1
quality.rows = 7
quality.simulated_rows = 7
quality.columns = 3
quality.simulated_columns = 3
quality.tolerance = 2e-5
"""
LEAVES = 5
FREE = f'[[detach]]\nfeathers = "falls"\nframe = {LEAVES}\n'


def shot_of(folder, more, groom=GROOM):
    (folder / "groom.toml").write_text(groom)
    (folder / "shot.toml").write_text(SHOT + more)
    return read_shot(folder / "shot.toml")


def run(shot, **options):
    """Poses of all frames, mass (n, 1 + 2 m) of the feather that falls, and the simulation."""
    simulation = simulate(shot, **options)
    frames = list(simulation)
    group = next(g for g in simulation._run.groups if "falls" in g.names)
    mass = group.solver.model.mass[group.names.index("falls")]
    return frames, mass, simulation


def centre(mass, points):
    return np.einsum("np,npk->k", mass, points.nodes) / mass.sum()


def test_in_vacuum_the_centre_of_mass_of_a_shaken_feather_flies_on_a_parabola(tmp_path):
    """From the frame of release on it has the velocity that it had then, and gravity alone."""
    more = (
        'motion = { base = "shake", direction = [0, 1, 0.5] }\n'
        '[wind]\nbase = "calm"\nair_density = 0\n' + FREE
    )
    frames, mass, _ = run(shot_of(tmp_path, more))
    start = frames[LEAVES - 1].poses[1]
    place, speed = centre(mass, start.points), centre(mass, start.velocities)
    assert np.linalg.norm(speed) > 0.05
    for frame in frames[LEAVES:]:
        t = (frame.number - LEAVES) / 24.0
        expected = place + t * speed + 0.5 * t**2 * np.array([0.0, 0.0, -9.81])
        # the integrator's own error over the first step, in which the root's pull ends
        assert centre(mass, frame.poses[1].points) == pytest.approx(expected, abs=2e-5)
    held = frames[-1].poses[0].points.nodes[0, 0]
    assert np.abs(held[0]) < 1e-12, "the other one stays on its root"


def test_until_it_leaves_a_feather_moves_as_if_it_stayed(tmp_path):
    motion = 'motion = "shake"\n'
    free, *_ = run(shot_of(tmp_path, motion + FREE))
    held, *_ = run(shot_of(tmp_path, motion))
    for k in range(LEAVES):
        assert np.array_equal(free[k].rows[1], held[k].rows[1])
    assert not np.array_equal(free[LEAVES].rows[1], held[LEAVES].rows[1])


PLATE = """
name = "plate"
[[feather]]
id = "falls"
kind = "body_contour"
position = [0, 0, 0]
direction = [1, 0, 0]
up = [0, 0, 1]

[feather.overrides]
length = 0.2
calamus = 0
rachis = { diameter_base = 1e-3, diameter_tip = 1e-3, taper = 1, camber = 0, sweep = 0, twist = 0 }
leading = SIDE
trailing = SIDE

[feather.overrides.rachis_material]
base = "keratin_rachis"
youngs_modulus = 5e11
shear_modulus = 1.5e11
cortex_fraction = 1

[feather.overrides.vane_material]
base = "swan_vane"
surface_density = 0.5
modulus_across_barbs = 4.8e7
shear_modulus = 2.8e7
barb_bending_normal = 10
barb_bending_in_plane = 10
bending_across = 1e-2
""".replace(
    "SIDE",
    "{ outline = [[0, 0], [0, 0.2], [1, 0.2], [1, 0]], rounded_base = 0, rounded_tip = 0,"
    " hooked = { rachis = [] },"
    " guides = [{ position = 0.5, angle = 90, curl = 0, camber = 0 }] }",
)


@pytest.mark.parametrize("carries_air", [False, True])
def test_a_flat_stiff_feather_falls_at_its_terminal_speed(tmp_path, carries_air):
    """m g = 1/2 rho S C v^2 and, on the way there, v = v_t tanh(m g t / (m + m_a) / v_t), m_a the
    mass of the air that it carries: it falls broadside."""
    more = "settle = false\nframes_per_second = 12\n[[detach]]\n"
    shot = shot_of(tmp_path, more, PLATE)
    frames, mass, _ = run(replace(shot, wind=replace(shot.wind, added_mass=carries_air)))
    drag = 0.5 * 1.225 * 1.2 * 2 * 0.04 * 0.2
    terminal = np.sqrt(mass.sum() * 9.81 / drag)
    carried = carries_air * 1.225 * np.pi / 4 * 0.08**2 * 0.2
    pull = 9.81 * mass.sum() / (mass.sum() + carried)
    for frame in frames[1:]:
        speed = centre(mass, frame.poses[0].velocities)
        expected = terminal * np.tanh(pull * frame.time / terminal)
        assert speed == pytest.approx([0.0, 0.0, -expected], abs=0.002 * terminal)
    assert speed[2] == pytest.approx(-terminal, rel=1e-3)


def test_a_checkpoint_in_flight_goes_on_with_the_same_bytes(tmp_path):
    shot = shot_of(tmp_path, FREE)
    whole, *_ = run(shot)
    first = simulate(shot, frames=(1, 8))
    list(first)
    rest = list(simulate(shot, start=first.checkpoint()))
    assert np.array_equal(rest[-1].rows[1], whole[-1].rows[1])


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ('[[detach]]\nfeathers = "falls"\nframe = 40\n', "40 is not of the shot. Give 1 to 18"),
        ('[[detach]]\nfeathers = "none"\n', "no feather of the groom fits 'none'"),
    ],
)
def test_what_cannot_leave_is_refused(tmp_path, more, told):
    with pytest.raises(InputError, match=told):
        shot_of(tmp_path, more)


def test_a_rigid_feather_cannot_leave(tmp_path):
    shot = shot_of(tmp_path, FREE + '[[detail]]\nfeathers = "falls"\nlevel = "rigid"\n')
    with pytest.raises(InputError, match="'falls' is rigid, but it leaves its root"):
        simulate(shot)
