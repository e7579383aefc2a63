"""Air and materials that no bird meets: one message that names the key, or a stable motion."""

import numpy as np
import pytest
from test_detach import GROOM, SHOT

from featherfx.errors import InputError
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot


def read(folder, wind, material=""):
    overrides = f'[overrides]\n"*" = {{ {material} }}\n' if material else ""
    (folder / "groom.toml").write_text(GROOM + overrides)
    (folder / "shot.toml").write_text(f'{SHOT}[wind]\nbase = "calm"\n{wind}\n')
    return read_shot(folder / "shot.toml")


@pytest.mark.parametrize(
    "air",
    [
        "air_density = 1000\nspeed = 2",
        pytest.param("speed = 150\ngust = 0.5", marks=pytest.mark.nightly),
        pytest.param("speed = 150\ngust = 0.5\nadded_mass = true", marks=pytest.mark.nightly),
    ],
)
def test_water_and_the_strongest_wind_move_a_feather_no_faster_than_they_flow(tmp_path, air):
    shot = read(tmp_path, f"{air}\ndirection = [0.3, 1, 0.5]")
    frames = list(simulate(shot))
    fastest = max(np.abs(each.poses[0].velocities.nodes).max() for each in frames)
    assert 0.0 <= fastest < 3.0 * shot.wind.speed
    places = np.array([each.poses[0].points.nodes for each in frames])
    assert np.abs(places).max() < 0.2


@pytest.mark.parametrize(
    ("wind", "material", "words"),
    [
        ("speed = 400", "", r"wind.speed: 400 is out of range.*0 to 150 m/s"),
        ("air_density = 1e5", "", r"wind.air_density: 100000 is out of range"),
        ("", "vane_material.permeability = -0.1", r"permeability: -0.1 is out of range.*0 to 1"),
        ("", "vane_material.permeability = 1.5", r"permeability: 1.5 is out of range.*0 to 1"),
        ("", "vane_material.loss_factor = 4", r"loss_factor: 4 is out of range.*0 to 1"),
        (
            "",
            "vane_material.attached_coefficient = -1",
            r"attached_coefficient: -1 is out of range",
        ),
    ],
)
def test_values_that_no_air_has_are_named_once(tmp_path, wind, material, words):
    with pytest.raises(InputError, match=words) as told:
        read(tmp_path, wind, material)
    assert len(told.value.problems) == 1
