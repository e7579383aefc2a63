"""The owl in flight: its wings and its coat before their layout, and what of them a shot moves."""

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.api import scene_readers
from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RACHIS_PART
from featherfx.groom.anatomy.drape import Body
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import read_shot

OWL = SAMPLES / "owl_flight"
# of its length, that a point of the tail goes in a frame: its roots stand, so all of it is the
# gusts', and 6 mm at the tip turn a feather by 3 degrees (by eye)
STILL = 0.05


@pytest.fixture(scope="module")
def shot():
    return read_shot(OWL / "shot.toml", (), scene_readers())


@pytest.fixture(scope="module")
def owl(shot):
    return shot.groom


def moves(shot):
    """(23,) the largest move of a point from frame to frame, over its feather's length."""
    length = np.array([feather.kind.length for feather in shot.groom.feathers])
    # of a row a point, two axes, which are no points, and its barbs' nodes
    points = np.array([np.delete(np.array(f.rows), [1, 2], axis=2) for f in simulate(shot)])
    ways = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    return (ways.max(axis=(2, 3)) / length).max(axis=1)


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
    # seen from above, the innermost vane lies over the trunk's side
    vane = next(f for f in inner if f.id == "left_wing_tertial_04")
    (built,) = build_feathers([vane], 11, 4)
    points = vane.position + built.surface.points(built.rest) @ vane.rotation.T
    corners = owl.skin.reshape(-1, 3)
    near = np.abs(points[:, None, 0] - corners[:, 0]) < 0.004
    beside = points[:, 1] - np.where(near, corners[:, 1], -np.inf).max(axis=1)
    assert beside.min() < -0.002


def test_coverts_lie_over_each_other_where_the_beat_folds_the_wing(owl, shot):
    """Rigid, in the plane of the wing: in frame 16, where elbow and wrist fold most, little more of
    them pass through each other than in frame 1, where an open arm is raised and vanes along it
    roll against each other."""
    own = [k for k, each in enumerate(owl.feathers) if "covert" in each.id and "wing" in each.id]
    built = build_feathers([owl.feathers[k] for k in own], 11, 4)

    def crossed(frame):
        roots = root_motion(shot).frames(shot.time_of(frame))
        points = [
            each.surface.points(each.rest) @ roots.rotations[k].T + roots.positions[k]
            for each, k in zip(built, own, strict=True)
        ]
        meshes = [
            (place, each.surface.triangles, each.surface.part == RACHIS_PART, number)
            for number, (place, each) in enumerate(zip(points, built, strict=True))
        ]
        return len(find_intersections(np.concatenate(points), make_patches(meshes)).owners)

    assert crossed(16) < 1.3 * crossed(1) < 130


def test_the_tail_does_not_twitch_in_gusts(owl, shot):
    tail = tuple(feather for feather in owl.feathers if feather.region == "tail")
    assert len(tail) == 12
    gusty = replace(shot.wind, gust=0.5)
    alone = replace(shot, groom=replace(owl, feathers=tail, layout=None), wind=gusty)
    sheltered = moves(alone).max()
    assert sheltered < STILL
    # each of the twelve in the whole wind, as if the others were not there
    bare = replace(alone, shelters=shot.shelters[:-1])
    assert moves(bare).max() > 5.0 * sheltered
