"""A single barb as a ribbon in a shot: its width meets the wind, and is written."""

import numpy as np
import pytest
from places import COARSE

from featherfx.baking.bake import bake
from featherfx.feather.build import build_feather
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot
from featherfx.solver.contact.surfaces import carried_mass
from featherfx.usd.read.cache import Cache

FEATHER = """
[[feather]]
id = "{name}"
kind = "peacock_barb"
position = [0, {place}, 0]
direction = [0, 0, 1]
up = {up}
overrides = {{ rachis = {{ camber = 0, sweep = 0, twist = 0 }} }}
"""
SHOT = (
    COARSE
    + """
name = "ribbons"
groom = "groom.toml"
frames = [1, 6]
gravity = [0, 0, 0]
wind = { base = "calm", speed = 0.1, direction = [1, 0, 0] }
"""
)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ribbons")
    groom = 'name = "ribbons"\n' + FEATHER.format(name="face_on", place=0, up="[1, 0, 0]")
    groom += FEATHER.format(name="edge_on", place=0.1, up="[0, 1, 0]")
    (folder / "groom.toml").write_text(groom)
    (folder / "shot.toml").write_text(SHOT)
    return folder / "shot.toml"


def test_wind_bends_a_ribbon_across_not_within_its_plane(shot):
    for frame in simulate(read_shot(shot)):
        face, edge = (np.abs(frame.rows[k][:, 0, 0]).max() for k in (0, 1))
        assert 0.01 < face < 0.1
        assert edge < 0.1 * face


def test_what_strikes_it_moves_the_whole_strip(shot):
    """Of a feather with soft barbs it moves a node alone."""
    kinds = read_shot(shot).groom.feathers[0].kind, feather_kind("swan_primary")
    ribbon, swan = (make_model([build_feather(each, 9, 2)], [each], 1) for each in kinds)
    np.testing.assert_allclose(carried_mass(ribbon), ribbon.mass.sum(), rtol=1e-12)
    assert (swan.segment[0, :, 5] > 0.0).all()
    np.testing.assert_array_equal(carried_mass(swan)[0, 5], swan.mass[0, 5])


def test_its_strip_is_written(shot, tmp_path):
    out = tmp_path / "out.usdc"
    bake(shot, out)
    cache = Cache(out)
    for code in (1.0, 6.0):
        size = np.ptp(cache.points(0, code), axis=0)
        assert size[1] == pytest.approx(4e-3, rel=0.01)
        assert size[0] > 0.01
