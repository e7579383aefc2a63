"""Wings that fold while a skin carries them."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.rotation import from_rotation_vector
from featherfx.groom.read.read import read_groom
from featherfx.shot.motion.fold import folding
from featherfx.shot.motion.joints import joint_roots, roots_at_rest, skeleton_of
from featherfx.shot.motion.limbs import carried
from featherfx.shot.motion.roots import RootFrames

GROOM = """
name = "bird"
[[wing]]
id = "right_wing"
type = { base = "pigeon", bow = 25 }
shoulder = [0.03, -0.03, 0.03]
fold = 1
mirror = "y"
[[feather]]
id = "breast"
kind = "contour"
position = [0.1, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
"""
KEYS = [{"time": 0.0, "fold": 1.0}, {"time": 1.0, "fold": 0.2}]


class Skin:
    """Carries all roots rigidly."""

    def __init__(self, rest):
        self.rest = rest

    def frames(self, time):
        turn = from_rotation_vector(time * np.array([0.2, -0.5, 0.8]))
        return RootFrames(
            self.rest.positions @ turn.T + [0.0, 0.0, time], turn @ self.rest.rotations
        )


def test_limbs_fold_on_the_skin_that_carries_them(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text(GROOM)
    groom = read_groom(path)
    joints = joint_roots(
        groom, skeleton_of(groom), folding(groom, {"joints": "*", "folds": KEYS}, "shot.toml")
    )
    skin = Skin(roots_at_rest(groom))
    roots = carried(groom, skin, joints)
    wings = np.array([feather.turning is not None for feather in groom.feathers])
    for time in (0.0, 0.4, 1.0):
        # a skin that moves rigidly carries the whole bird, as its joints pose it
        expected = Skin(joints.frames(time)).frames(time)
        found, on_skin = roots.frames(time), skin.frames(time)
        for name in ("positions", "rotations"):
            np.testing.assert_allclose(
                getattr(found, name)[wings], getattr(expected, name)[wings], atol=1e-12
            )
            np.testing.assert_array_equal(
                getattr(found, name)[~wings], getattr(on_skin, name)[~wings]
            )
    assert np.abs(roots.frames(1.0).positions - skin.frames(1.0).positions).max() > 0.05


def test_a_bowed_wing_opens_to_where_the_groom_has_it(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text(GROOM)
    folded = read_groom(path)
    path.write_text(GROOM.replace("fold = 1", "fold = 0.2"))
    opened = roots_at_rest(read_groom(path))
    poses = folding(folded, {"joints": "*", "folds": KEYS}, "shot.toml")
    found = joint_roots(folded, skeleton_of(folded), poses).frames(1.0)
    np.testing.assert_allclose(found.positions, opened.positions, atol=1e-9)
    np.testing.assert_allclose(found.rotations, opened.rotations, atol=1e-9)
