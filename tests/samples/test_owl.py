"""The owl in flight: its wings and its coat before their layout, and what of them a shot moves."""

import numpy as np
import pytest
from places import SAMPLES

from featherfx.api import scene_readers
from featherfx.groom.anatomy.lie import Body
from featherfx.groom.read.read import read_groom as read_placed

OWL = SAMPLES / "owl_flight"


@pytest.fixture(scope="module")
def owl():
    return read_placed(OWL / "groom.toml", (), scene_readers())


def ends(feather):
    return feather.position + feather.kind.length * feather.rotation[:, 0]


def test_two_spread_wings_stand_at_a_body_with_a_coat(owl):
    tips = np.array([ends(f) for f in owl.feathers if "wing_primary" in f.id])
    assert len(tips) == 20
    # m; of a barn owl 80 to 95 cm, along the arcs of its shafts a little more
    assert 0.75 < np.ptp(tips[:, 1]) < 1.05
    assert np.sort(tips[:, 1]) == pytest.approx(-np.sort(tips[:, 1])[::-1], abs=1e-9)
    coat = [f for f in owl.feathers if f.region in ("breast", "belly", "mantle", "back", "nape")]
    assert len(coat) > 300


def test_wings_meet_the_body(owl):
    body = Body(owl.skin, np.eye(3), np.zeros(3))
    inner = [f for f in owl.feathers if "wing_tertial" in f.id]
    ways = np.linspace(0.0, 1.0, 5)[:, None]
    shafts = [body.gaps(f.position + f.kind.length * ways * f.rotation[:, 0]) for f in inner]
    # over the skin; up to there the coat reaches, 3 cm long
    assert 0.0 < np.min(shafts) < 0.03
