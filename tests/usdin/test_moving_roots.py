"""Roots on a skin that bends and flies: frames that are smooth over the skin."""

import creature
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import featherfx


def turns_of(skin, time):
    """Rotations since rest of the roots of a bound skin."""
    return skin.frames(time).rotations @ skin.rotations.transpose(0, 2, 1)


def differences(turns):
    """rad, from each root of a row to the next."""
    return Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()


@pytest.mark.parametrize("radius", ["", "radius = 0", "radius = 0.1"])
@pytest.mark.parametrize("make", [creature.sampled, creature.skinned])
def test_neighbours_share_the_bend_of_the_skin(tmp_path, make, radius):
    """By default, with the faces at the root alone, and averaged over a part of the skin."""
    shot = featherfx.read_shot(creature.write_shot(tmp_path, make, skin=radius))
    y = np.linspace(-0.5, 0.5, 60)
    for frame in (0, 5, 11):
        time = frame / creature.RATE
        turns = turns_of(shot.skin, time)
        share = np.abs(np.diff(creature.bend(y, time)))
        assert share.min() > 1e-3
        ratio = differences(turns) / share
        assert ratio.max() < 1.5
        expected = Rotation.from_euler("x", creature.bend(y, time)[:, None]).as_matrix()
        apart = Rotation.from_matrix(turns @ expected.transpose(0, 2, 1)).magnitude()
        assert apart.max() < 0.03 * creature.BEND
