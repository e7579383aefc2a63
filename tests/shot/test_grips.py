"""Grips have a largest force: what they cannot lead stays behind, and is told."""

from itertools import pairwise

import numpy as np
import pytest
from places import COARSE

from featherfx.api import read_shot
from featherfx.cli.bake_warnings import print_warnings
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.node_kernels import add_grip_forces, grip_energy
from featherfx.shot.loop.simulate import simulate

GROOM = """name = "g"
[[feather]]
id = "f0"
kind = "{kind}"
position = [0, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
"""
SHOT = """name = "s"
groom = "g.toml"
frames = [1, 6]
{quality}[[grip]]
feather = "f0"
row = {row}
column = {column}
displacement = {displacement}
end = 0.15
stiffness = 130
{more}
"""


def pulled(folder, kind, displacement, row=1.0, column=0.0, more=""):
    (folder / "g.toml").write_text(GROOM.format(kind=kind))
    given = {"row": row, "column": column, "displacement": displacement, "more": more}
    (folder / "s.toml").write_text(SHOT.format(quality=COARSE, **given))
    simulation = simulate(read_shot(folder / "s.toml"))
    frames = [frame.poses[0].points.nodes[:, 0] for frame in simulation]
    rest = simulation.feathers[0].rest.nodes[:, 0]
    stretch = max(length(each) for each in frames) / length(rest)
    return stretch, simulation.report.get("grips_at_limit", [])


def length(points):
    return sum(np.linalg.norm(b - a) for a, b in pairwise(points))


@pytest.mark.parametrize(
    ("kind", "displacement", "row", "column"),
    [
        ("bristle", [-0.3, 0, 0], 1.0, 0.0),
        ("contour", [-0.5, 0.1, 0], 1.0, 0.0),
        ("primary", [-2.0, 0, 0], 0.6, 0.0),
        ("covert", [-0.5, 0, 0.2], 0.7, 1.0),
    ],
)
def test_no_grip_tears_a_rachis_apart(tmp_path, capsys, kind, displacement, row, column):
    stretch, told = pulled(tmp_path, kind, displacement, row, column)
    assert stretch < 1.1
    (each,) = told
    assert each["feather"] == "f0"
    assert each["strain"] < 0.2
    assert each["distance"] > 0.05
    print_warnings({"grips_at_limit": told})
    assert "'f0' at row" in capsys.readouterr().err


def test_a_grip_that_bends_is_not_bound(tmp_path):
    assert pulled(tmp_path, "primary", [0.02, 0, 0.05])[1] == []


def test_a_given_force_binds(tmp_path):
    _, told = pulled(tmp_path, "primary", [0, 0, 0.1], more="max_force = 1e-3")
    assert told[0]["force"] == 1e-3


@pytest.mark.parametrize("slack", [0.0, 0.004])
@pytest.mark.parametrize("distance", [0.002, 0.006, 0.03])
def test_the_pull_is_the_gradient_of_its_energy_and_ends_at_the_largest_force(slack, distance):
    loads = no_loads(1)._replace(
        grip_node=np.zeros((1, 1, 2), dtype=np.int64),
        grip_start=np.zeros((1, 1, 3)),
        grip_end=np.zeros((1, 1, 3)),
        grip_stiffness=np.full((1, 1), 100.0),
        grip_slack=np.full((1, 1), slack),
        max_grip_force=np.full((1, 1), 0.5),
    )
    at = distance * np.array([0.6, 0.0, 0.8])

    def gradient(point):
        force, stiff = np.zeros((1, 1, 3)), np.zeros((1, 1, 6))
        add_grip_forces(loads, 0, 0.0, point[None, None], force, stiff)
        return force[0, 0], stiff[0, 0]

    pull, stiff = gradient(at)
    assert np.linalg.norm(pull) == pytest.approx(min(100.0 * max(distance - slack, 0.0), 0.5))
    for k, step in enumerate(1e-7 * np.eye(3)):
        ends = [grip_energy(loads, 0, 0.0, (at + s * step)[None, None]) for s in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-7 == pytest.approx(pull[k], abs=1e-6)
        slope = (gradient(at + step)[0] - gradient(at - step)[0]) / 2e-7
        assert slope[k] == pytest.approx(stiff[k], abs=1e-3)
