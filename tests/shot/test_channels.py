"""Channels: what a director asks of some feathers over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import ROOT, SAMPLES

from featherfx.errors import InputError, InputWarning
from featherfx.shot.direction.channels import courses
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import motion_dependences, root_motion
from featherfx.shot.patterns import CHANNELS, Channel, Detail
from featherfx.shot.read.read import read_shot

# m, within the reach of the roots of two wings
SOFT = 1.0


@pytest.fixture(scope="module")
def shot():
    """The feathers of one wing on a coarse grid, in still air."""
    read = read_shot(SAMPLES / "swan_wing" / "shot.toml")
    quality = replace(read.quality.pushing, rows=11, columns=3, coefficients=1, simulated_rows=0)
    return replace(
        read, quality=quality, wind=replace(read.wind, speed=0.0), motion=held(), last_frame=5
    )


def held():
    read = read_shot(SAMPLES / "wet_feather" / "shot.toml")
    assert read.motion.kind == "hold"
    return read.motion


def directed(shot, *channels):
    return replace(shot, channels=channels)


def frames_of(shot, *channels, time=0.0):
    return root_motion(directed(shot, *channels)).frames(time)


def const(name, value, **where):
    return Channel(name=name, keys=((1.0, value),), **where)


def test_values_pass_through_keys_without_overshoot_and_hold_outside(shot):
    channel = Channel(name="ruffle", keys=((1, 0), (3, 40), (4, 40), (9, 10)))
    (course,) = courses(directed(shot, channel), ("ruffle",))
    rate = shot.frames_per_second
    at = [course.value((frame - shot.first_frame) / rate) for frame in (-50, 1, 3, 3.5, 4, 9, 99)]
    assert at == pytest.approx([0, 0, 40, 40, 40, 10, 10])
    between = [course.value(t / rate) for t in np.linspace(0, 12, 200)]
    assert min(between) >= 0.0
    assert max(between) <= 40.0
    # no kick: the rate of the value is continuous
    fine = np.array([course.value(t / rate) for t in np.linspace(-1, 10, 4401)])
    assert np.abs(np.diff(fine, 2)).max() < 0.02 * np.abs(np.diff(fine)).max()


@pytest.mark.parametrize(
    ("name", "axis"), [("ruffle", (0, 2)), ("sleek", (0, -2)), ("turn", (1, 2))]
)
def test_a_follicle_turns_by_the_angle_to_its_side(shot, name, axis):
    """The axis that moves comes up to the dorsal side, or goes down from it."""
    before, after = frames_of(shot), frames_of(shot, const(name, 30.0))
    moved, to = axis
    side = np.sign(to) or 1.0
    rose = np.einsum("fk,fk->f", after.rotations[:, :, moved], before.rotations[:, :, 2])
    mirrored = np.array([each.mirrored for each in shot.groom.feathers])
    wanted = np.where(mirrored & (name == "turn"), -0.5, 0.5) * side
    assert rose == pytest.approx(wanted, abs=1e-12)
    assert after.positions == pytest.approx(before.positions)


def test_angles_add_up_and_roots_rise(shot):
    before = frames_of(shot)
    both = frames_of(shot, const("ruffle", 30.0), const("sleek", 20.0))
    one = frames_of(shot, const("ruffle", 10.0))
    assert both.rotations == pytest.approx(one.rotations, abs=1e-12)
    risen = frames_of(shot, const("puff", 0.01)).positions - before.positions
    assert risen == pytest.approx(0.01 * before.rotations[:, :, 2], abs=1e-12)


def test_a_fan_spreads_by_its_angle_and_a_fold_brings_all_together(shot):
    def spread(frames):
        directions = frames.rotations[:, :, 0]
        return np.degrees(np.arccos(np.clip(directions @ directions.T, -1.0, 1.0))).max()

    open_, wider = spread(frames_of(shot)), spread(frames_of(shot, const("fan", 12.0)))
    assert wider == pytest.approx(open_ + 12.0, abs=1.0)
    half, closed = (spread(frames_of(shot, const("fold", part))) for part in (0.5, 1.0))
    assert half < 0.6 * open_
    assert closed < 0.15 * open_


@pytest.mark.parametrize(("name", "value"), [("fan", 30.0), ("fold", 1.0)])
def test_a_fan_and_a_fold_are_of_each_wing_for_itself(tmp_path, name, value):
    """Both wings at once turn as either one alone."""
    groom = tmp_path / "groom.toml"
    groom.write_text(
        'name = "w"\n[[wing]]\nid = "right_wing"\ntype = "pigeon"\nshoulder = [0.03, -0.03, 0]\n'
        'fold = 0\nmirror = "y"\n'
    )
    (tmp_path / "shot.toml").write_text('name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n')
    wings = replace(read_shot(tmp_path / "shot.toml"), motion=held())
    right, left, both = (
        frames_of(wings, const(name, value, feathers=own)).rotations
        for own in ("right_*_primary_*", "left_*_primary_*", "*_primary_*")
    )
    still = frames_of(wings).rotations
    assert np.abs(right - still).max() > 0.1
    assert both == pytest.approx(right + left - still, abs=1e-12)


def test_a_soft_border_fades_with_the_distance_of_roots_outside(shot):
    channel = Channel(name="ruffle", feathers="right_*", keys=((1, 90),), soft=SOFT)
    (course,) = courses(directed(shot, channel), ("ruffle",))
    inside = np.array([each.id.startswith("right_") for each in shot.groom.feathers])
    roots = np.array([each.position for each in shot.groom.feathers])
    apart = np.linalg.norm(roots[inside][:, None] - roots[~inside], axis=2).min(axis=1)
    weights = course.weights[inside]
    assert (course.weights[~inside] == 0.0).all()
    assert (np.diff(weights[np.argsort(apart)]) >= 0.0).all()
    assert weights == pytest.approx(
        np.where(apart < SOFT, 3 * (apart / SOFT) ** 2 - 2 * (apart / SOFT) ** 3, 1.0)
    )
    assert 0.0 < weights.min() < weights.max()


def first(shot, *channels, last=None):
    chosen = directed(replace(shot, last_frame=last or shot.first_frame), *channels)
    return list(simulate(chosen))[-1]


def test_weight_and_stiffness_bend_what_hangs(shot):
    """Sag of the tips: twice the weight on twice the moduli is the same shape."""
    rest = [
        np.asarray(pose.points.nodes[-1, 0]) for pose in first(shot, const("follow", 0.0)).poses
    ]

    def sag(*channels):
        found = first(shot, *channels).poses
        return np.array(
            [np.linalg.norm(p.points.nodes[-1, 0] - r) for p, r in zip(found, rest, strict=True)]
        )

    plain, heavy = sag(), sag(const("gravity", 2.0))
    stiff = sag(const("stiffness", 4.0))
    same = sag(const("gravity", 2.0), const("stiffness", 2.0))
    assert np.all(heavy > 1.7 * plain)
    assert stiff == pytest.approx(plain / 4.0, rel=0.1)
    assert same == pytest.approx(plain, rel=1e-4)
    assert sag(const("gravity", 0.0)).max() < 1e-6


def test_wind_that_is_not_felt_moves_nothing(shot):
    windy = replace(shot, wind=replace(shot.wind, speed=8.0, gust=0.3), last_frame=3)
    still = first(shot, last=3)
    calm = first(windy, const("wind", 0.0), last=3)
    blown = first(windy, last=3)
    apart = [
        max(
            np.abs(a.points.nodes - b.points.nodes).max()
            for a, b in zip(x.poses, y.poses, strict=True)
        )
        for x, y in ((calm, still), (blown, still))
    ]
    assert apart[0] < 1e-6
    assert apart[1] > 1e-3


def test_what_is_asked_of_feathers_that_are_not_simulated_is_told(shot):
    right = Detail(feathers="right_*", level="rigid")
    asked = replace(
        shot,
        details=(right,),
        channels=(
            const("wind", 2.0, feathers="right_*"),
            const("wind", 1.0, feathers="right_*"),
            const("gravity", 0.5),
            const("ruffle", 5.0, feathers="right_*"),
        ),
    )
    with pytest.warns(InputWarning) as told:
        simulate(asked)
    (said,) = (str(each.message) for each in told)
    assert "channel[0]: none of its 10 feathers is simulated, so none feels wind" in said


@pytest.mark.parametrize("level", ["full", "guided"])
def test_one_feather_is_calmed_by_its_id(shot, level):
    """Of what bends it a share is kept, whether it is simulated or guided; others are as before."""
    own = shot.groom.feathers[2].id
    bent = replace(shot, details=(Detail(feathers=own, level=level, every=0),))
    heavy = const("gravity", 3.0)
    none, calm, whole = (
        [p.points.nodes for p in first(bent, heavy, const("follow", share, feathers=own)).poses]
        for share in (0.0, 0.25, 1.0)
    )
    tips = [each[2][-1, 0] for each in (none, calm, whole)]
    way = np.linalg.norm(tips[2] - tips[0])
    assert way > 1e-3
    assert np.linalg.norm(tips[1] - tips[0]) == pytest.approx(0.25 * way, rel=0.1)
    rest = [np.array_equal(a, b) for a, b in zip(calm, whole, strict=True)]
    assert rest == [each.id != own for each in bent.groom.feathers]


def test_a_channel_leaves_out_what_it_excludes(shot):
    names = [each.id for each in shot.groom.feathers]
    channel = Channel(name="ruffle", keys=((1, 9),), exclude=("left_*", names[1]))
    (course,) = courses(directed(shot, channel), ("ruffle",))
    left = [name.startswith("left_") or name == names[1] for name in names]
    assert (course.weights == 0.0).tolist() == left


def test_follow_through_scales_what_is_simulated_without_stretching(shot):
    heavy = const("gravity", 3.0)
    whole, half, none = (first(shot, heavy, const("follow", share)) for share in (1.0, 0.5, 0.0))
    plain = first(shot, heavy)
    for k, pose in enumerate(whole.poses):
        # put together again it has no stretch of the shaft
        assert pose.points.nodes == pytest.approx(plain.poses[k].points.nodes, abs=1e-6)
        tips = [each.poses[k].points.nodes[-1, 0] for each in (none, half, whole)]
        apart = np.linalg.norm(tips[2] - tips[0])
        assert np.linalg.norm(tips[1] - tips[0]) == pytest.approx(0.5 * apart, rel=0.05)
        lengths = [
            np.linalg.norm(np.diff(each.poses[k].points.nodes[:, 0], axis=0), axis=1).sum()
            for each in (none, half, whole)
        ]
        assert lengths == pytest.approx([lengths[0]] * 3, rel=1e-4)


def test_rates_of_a_share_that_changes_are_those_of_the_points(shot):
    keys = Channel(name="follow", keys=((1, 0.0), (5, 1.0)))
    moving = directed(shot, keys, const("gravity", 3.0))
    samples = list(simulate(moving, subframes=8))
    step = 1.0 / (8.0 * shot.frames_per_second)
    k = len(samples) // 2
    for pose, before, after in zip(
        samples[k].poses, samples[k - 1].poses, samples[k + 1].poses, strict=True
    ):
        rate = (after.points.nodes - before.points.nodes) / (2.0 * step)
        scale = np.abs(rate).max()
        assert np.abs(pose.velocities.nodes - rate).max() < 0.02 * scale


def test_only_what_a_channel_touches_depends_on_it(shot):
    own = shot.groom.feathers[1].id
    before = motion_dependences(shot)
    after = motion_dependences(directed(shot, const("ruffle", 5.0, feathers=own)))
    assert [a != b for a, b in zip(before, after, strict=True)] == [
        each.id == own for each in shot.groom.feathers
    ]


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('name = "rufle"\nkeys = [[1, 2]]', "rufle"),
        ('name = "fold"\nkeys = [[1, 1.5]]', "1.5 is out of range. Give fold 0 to 1"),
        ('name = "ruffle"\nkeys = [[5, 1], [2, 3]]', "frame 2 is not later than frame 5"),
        ('name = "ruffle"\nregion = "tial"\nkeys = [[5, 1]]', "no region of the groom fits 'tial'"),
        ('name = "ruffle"', "keys"),
    ],
)
def test_a_wrong_channel_is_one_message(tmp_path, entry, said):
    groom = SAMPLES / "swan_wing" / "groom.toml"
    file = tmp_path / "shot.toml"
    file.write_text(
        f'name = "s"\ngroom = "{groom.as_posix()}"\nframes = [1, 9]\n[[channel]]\n{entry}\n'
    )
    with pytest.raises(InputError) as caught:
        read_shot(file)
    assert len(caught.value.problems) == 1
    assert said in str(caught.value)


def test_every_channel_is_explained():
    text = (ROOT / "docs/direction.md").read_text()
    assert [name for name in CHANNELS if f"`{name}`" not in text] == []
