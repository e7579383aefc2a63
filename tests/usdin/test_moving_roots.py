"""Roots on a skin that bends and flies: frames that are smooth over the skin."""

import creature
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation

import featherfx
from featherfx.shot.frames import StageClock
from featherfx.shot.loads import estimate_loads
from featherfx.shot.motion.cuts import CutRoots
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.roots import PickedRoots, RunUp, RunUpRoots, some_roots
from featherfx.shot.types import part_of


def turns_of(skin, time):
    """Rotations since rest of the roots of a bound skin."""
    return skin.frames(time).rotations @ skin.rotations.transpose(0, 2, 1)


def differences(turns):
    """rad, from each root of a row to the next."""
    return Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()


@pytest.mark.parametrize("radius", ["", "smoothing_radius = 0", "smoothing_radius = 0.1"])
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


def rates(skin, time, step):
    """(4, F, 3) velocities and accelerations just before and just after a time."""
    found = []
    for side in (-1, 1):
        near, mid, far = (skin.frames(time + side * k * step).positions for k in (0, 1, 2))
        found += [side * (4 * mid - 3 * near - far) / (2 * step), (far - 2 * mid + near) / step**2]
    return found


@pytest.mark.parametrize("make", [creature.sampled, creature.skinned])
def test_roots_move_smoothly_between_samples(tmp_path, make):
    """Velocity and acceleration are continuous at samples."""
    skin = featherfx.read_shot(creature.write_shot(tmp_path, make)).skin
    for frame in (3, 8, 13):
        before, bent_before, after, bent_after = rates(skin, frame / creature.RATE, 2e-3)
        assert np.abs(after - before).max() < 0.2
        assert np.abs(bent_after - bent_before).max() < 0.4 * np.abs(bent_after).max()


def test_velocities_are_those_of_the_motion(tmp_path):
    """Against the body's own formula at its middle, also at the first and the last sample."""
    path = creature.write_shot(tmp_path, creature.sampled, count=3)
    skin = featherfx.read_shot(path).skin
    for frame, off in ((0, 0.09), (0.5, 0.05), (6, 0.005), (11.3, 0.005), (23, 0.09)):
        time, step = frame / creature.RATE, 1e-3
        middle = (skin.frames(time + step).positions - skin.frames(time - step).positions)[1]
        true = (creature.body_shift(time + step) - creature.body_shift(time - step)) / (2 * step)
        assert middle[0] / (2 * step) == pytest.approx(true[0], rel=1e-3)
        assert abs(middle[2] / (2 * step) - true[2]) < off * 0.05 * 2 * np.pi * creature.BEAT


def test_poses_at_whole_frames_are_those_of_the_stage(tmp_path):
    """Smooth between frames, and as the stage has it where it is told so."""
    path = creature.write_shot(tmp_path, creature.skinned)
    smooth = featherfx.read_shot(path).skin
    path.write_text(path.read_text() + 'interpolation = "linear"\n')
    linear = featherfx.read_shot(path).skin
    for frame in (0, 7, 23):
        time = frame / creature.RATE
        np.testing.assert_allclose(
            smooth.frames(time).positions, linear.frames(time).positions, atol=2e-6
        )
    apart = (
        smooth.frames(7.5 / creature.RATE).positions - linear.frames(7.5 / creature.RATE).positions
    )
    assert 1e-3 < np.abs(apart).max() < 0.05


def test_motion_goes_on_beyond_the_samples_or_comes_to_rest_where_it_is_held(tmp_path):
    path = creature.write_shot(tmp_path, creature.sampled, count=3)
    skin = featherfx.read_shot(path).skin
    step = 1.0 / creature.RATE
    before, after = (skin.frames(time).positions[1] for time in (-step, 0.0))
    assert (after - before)[0] == pytest.approx(creature.SPEED * step, rel=1e-3)
    path = creature.write_shot(
        tmp_path / "held",
        creature.sampled,
        count=3,
        skin='extrapolation = "hold"',
        frames=(creature.FIRST, creature.LAST + 5),
    )
    skin = featherfx.read_shot(path).skin
    last = (creature.LAST - creature.FIRST) * step
    speeds = []
    for time in np.arange(last - 2 * step, last + 3 * step, step / 8):
        before, after = (skin.frames(each).positions[1] for each in (time, time + step / 8))
        speeds.append((after - before)[0] / (step / 8))
    assert np.abs(speeds[-4:]).max() < 1e-6
    # from 12 m/s to rest over two frames, not at once
    assert np.abs(np.diff(speeds)).max() < 0.2 * creature.SPEED


def test_some_of_the_roots_move_as_all_do(tmp_path):
    shot = featherfx.read_shot(creature.write_shot(tmp_path, creature.sampled, count=9))
    some, motion = np.array([1, 2, 7]), RunUpRoots(root_motion(shot), RunUp(0.5, (0.1, 0.0, 0.0)))
    cut = CutRoots(motion, StageClock())
    picked = PickedRoots(shot.skin, np.arange(9))  # which cannot be moved one without the others
    for time in (-0.2, 0.31):
        for whole in (shot.skin, motion, cut, picked):
            for every, own in zip(
                whole.frames(time), some_roots(whole, some).frames(time), strict=True
            ):
                np.testing.assert_array_equal(own, every[some])
        part = part_of(shot, some).skin.frames(time)
        np.testing.assert_array_equal(part.positions, shot.skin.frames(time).positions[some])


def test_loads_of_some_feathers_are_those_among_all(tmp_path):
    shot = featherfx.read_shot(creature.write_shot(tmp_path, creature.sampled, count=9))
    whole, part = (estimate_loads(shot, root_motion(shot), each) for each in (None, [1, 2, 7]))
    for every, own in zip(whole, part, strict=True):
        np.testing.assert_array_equal(own[[1, 2, 7]], every[[1, 2, 7]])
        assert np.isnan(own[[0, 3, 8]]).all()


@pytest.mark.parametrize("turn", [170.0, 288.0])
def test_a_spin_that_frames_do_not_show_is_told(tmp_path, recwarn, turn):
    """By more than half a turn a frame, smooth motion would go the other way round."""
    path = creature.write_shot(tmp_path, creature.sampled, count=3)
    stage = Usd.Stage.Open(str(tmp_path / "creature.usda"))
    spin = UsdGeom.Xformable(stage.GetPrimAtPath("/creature/skin"))
    spin.ClearXformOpOrder()
    angle = spin.AddRotateXOp()
    for code, time in creature.times():
        angle.Set(turn * creature.RATE * time, code)
    stage.Save()
    featherfx.read_shot(path)
    told = [str(each.message) for each in recwarn if "degrees" in str(each.message)]
    assert len(told) == (turn > 180.0)
    assert all("/creature/skin turns by 288 degrees from time code" in each for each in told)
    recwarn.clear()
    path.write_text(path.read_text() + 'interpolation = "linear"\n')
    skin = featherfx.read_shot(path).skin
    assert not [each for each in recwarn if "degrees" in str(each.message)]
    middle = turns_of(skin, 0.5 / creature.RATE)[1] @ turns_of(skin, 0.0)[1].T
    assert np.degrees(Rotation.from_matrix(middle).magnitude()) == pytest.approx(turn / 2, abs=0.1)
