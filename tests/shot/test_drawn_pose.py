"""The drawn pose as balance under gravity: on every grid, in every direction, or told."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from featherfx.api import read_shot
from featherfx.errors import InputWarning
from featherfx.shot.loop.simulate import simulate

GROOM = """
name = "g"
drawn_pose = "{pose}"
{more}
[[feather]]
id = "right_f"
kind = "{kind}"
position = [0, 0, 0]
direction = {direction}
up = [0.3, 0.2, 1]
mirror = "y"
"""
# an upright barb is longer than what bears its own weight
UPRIGHT = (0.02, 0, 1)
SHOT = 'name = "s"\ngroom = "g.toml"\nframes = [1, 3]\nquality = "{quality}"\n'


def distances(folder, kind="peacock_train", direction=(-1, 0.2, 0), quality="draft", **changes):
    """Largest distance of a node from the drawn pose at the last frame, of the length."""
    pose, more = changes.pop("pose", "equilibrium"), changes.pop("more", "")
    text = GROOM.format(kind=kind, direction=list(direction), pose=pose, more=more)
    (folder / "g.toml").write_text(text)
    (folder / "s.toml").write_text(SHOT.format(quality=quality))
    shot = replace(read_shot(folder / "s.toml"), **changes)
    simulation = simulate(shot)
    frame = list(simulation)[-1]
    each = zip(frame.poses, simulation.feathers, shot.groom.feathers, strict=True)
    return [
        np.linalg.norm(
            pose.points.nodes - feather.rest.nodes @ placed.rotation.T - placed.position, axis=-1
        ).max()
        / placed.kind.length
        for pose, feather, placed in each
    ]


@pytest.mark.parametrize(
    ("kind", "direction"),
    [
        ("peacock_train", (-1, 0, 0)),
        ("peacock_train", (0.2, 1, 0.6)),
        ("peacock_tail", (0, 1, -0.4)),
        ("ornamental_plume", (-1, 0.3, 0)),
        ("semiplume", (0.5, -1, 0.2)),
        ("peacock_barb", (0.1, 1, 0.3)),
    ],
)
def test_the_drawn_pose_is_the_balance(tmp_path, kind, direction):
    assert max(distances(tmp_path, kind, direction, pose="unloaded")) > 1e-3
    assert max(distances(tmp_path, kind, direction)) < 1e-6


def test_it_is_the_balance_on_every_grid(tmp_path):
    assert max(distances(tmp_path, quality="draft")) < 1e-6
    assert max(distances(tmp_path, quality="final")) < 1e-6


def test_without_gravity_it_rises_and_in_the_grooms_own_it_stays(tmp_path):
    sagging = max(distances(tmp_path, pose="unloaded"))
    weightless = max(distances(tmp_path, gravity=np.zeros(3)))
    assert 0.5 * sagging < weightless < 2.0 * sagging
    side = "gravity = [0, 3, 0]"
    assert max(distances(tmp_path, more=side, gravity=np.array([0.0, 3.0, 0.0]))) < 1e-6
    assert max(distances(tmp_path, more=side)) > 0.1


def test_a_feather_without_such_a_shape_is_named(tmp_path):
    with pytest.warns(InputWarning, match=r"drawn_pose: no unloaded shape .* of right_f, left_f"):
        found = distances(tmp_path, "peacock_barb", UPRIGHT)
    assert found == pytest.approx(
        distances(tmp_path, "peacock_barb", UPRIGHT, pose="unloaded"), abs=1e-4
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        distances(tmp_path, "covert")
