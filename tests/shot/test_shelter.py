"""Feathers that their plumage keeps from the wind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.shot.loads import exposures
from featherfx.shot.loop.placement import place_feathers
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.patterns import Shelter
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Motion, Shot


def one_feather(speed: float, share: float | None, gust: float = 0.3) -> Shot:
    """A feather held in a wind across its vane, without carried air, for some frames."""
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    across = np.array([0.0, 0.6, 0.8])
    wind = replace(
        shot.wind, speed=speed, gust=gust, direction=across, gust_length=0.5, added_mass=False
    )
    return replace(
        shot,
        first_frame=0,
        last_frame=4,
        grips=(),
        wind=wind,
        quality=replace(shot.quality.pushing, rows=9, columns=3, coefficients=1, simulated_rows=0),
        shelters=() if share is None else (Shelter(share=share),),
    )


def points_of(shot: Shot) -> np.ndarray:
    return np.array([frame.rows[0] for frame in simulate(shot)])


def test_no_shelter_changes_nothing() -> None:
    whole = points_of(one_feather(3.0, None))
    np.testing.assert_array_equal(points_of(one_feather(3.0, 0.0)), whole)
    assert np.abs(points_of(one_feather(3.0, 0.5)) - whole).max() > 1e-4


def test_all_of_the_wind_kept_off_is_still_air() -> None:
    np.testing.assert_array_equal(
        points_of(one_feather(3.0, 1.0)), points_of(one_feather(0.0, None, 0.0))
    )


def test_half_of_the_wind_bends_as_a_wind_of_half_the_speed() -> None:
    # steady: gusts travel with the wind, so slower ones come at other times
    half, slow = points_of(one_feather(3.0, 0.5, 0.0)), points_of(one_feather(1.5, None, 0.0))
    np.testing.assert_allclose(half, slow, atol=1e-12)


def test_air_in_the_plumage_goes_with_the_body() -> None:
    """A body at 10 m/s in still air, all of which is kept off, is one in a wind that keeps up."""
    # keys reach far to both sides, because a motion starts and ends at rest
    times = np.linspace(-5.0, 5.0, 101).tolist()
    keys = [{"time": t, "joint": "", "position": (10.0 * t, 0.0, 0.0)} for t in times]
    flight = {"motion": Motion("keys", {"keyframes": keys}), "settle": False, "preroll": 0}
    inside = replace(one_feather(0.0, 1.0, 0.0), **flight)
    wind = replace(inside.wind, speed=10.0, direction=np.array([1.0, 0.0, 0.0]))
    outside = replace(one_feather(0.0, None, 0.0), **flight)
    going_along = points_of(replace(outside, wind=wind))
    np.testing.assert_allclose(points_of(inside), going_along, atol=1e-8)
    assert np.abs(points_of(outside) - going_along).max() > 1e-3


def test_air_in_the_plumage_turns_with_a_wing() -> None:
    """Turned about its root at 1,200 degrees a second, a feather in air that turns with it hangs
    back no farther than in a vacuum; of air about its root alone it would feel all."""
    times = np.linspace(-1.0, 1.0, 21)
    keys = [{"time": t, "joint": "", "rotation": (0.0, 1200.0 * t, 0.0)} for t in times.tolist()]
    turning = {"motion": Motion("keys", {"keyframes": keys}), "settle": False, "preroll": 0}
    kept_off, still = (replace(one_feather(0.0, share, 0.0), **turning) for share in (1.0, None))
    vacuum = replace(still, wind=replace(still.wind, air_density=0.0))
    inside, alone, free = (points_of(each)[-1] for each in (kept_off, still, vacuum))
    assert np.abs(inside - free).max() < 0.25 * np.abs(alone - free).max()


@pytest.mark.nightly
def test_coverts_of_a_beating_wing_stay_on_their_sheet(tmp_path: Path) -> None:
    """A pigeon's wing without a skin at 6.7 beats a second in calm air, its outermost coverts."""
    (tmp_path / "groom.toml").write_text(
        "name = 'g'\n[[wing]]\nid = 'w'\ntype = 'pigeon'\nshoulder = [0, 0, 0]\nfold = 0\n"
    )
    path = tmp_path / "shot.toml"
    path.write_text(
        "name = 's'\ngroom = 'groom.toml'\nframes = [1, 9]\nquality = 'preview'\nwind = 'calm'\n"
        "motion = { base = 'pigeon_beat', wingbeat_frequency = 6.7 }\n"
    )
    shot = place_feathers(read_shot(path))
    names = [each.id for each in shot.groom.feathers]
    chosen = [f for f, name in enumerate(names) if "covert" in name and name[-2:] in ("23", "24")]
    moved = Simulation(shot, 1, None, 4, wanted=chosen)
    for frame in moved:
        for f, feather, rows in zip(chosen, moved.feathers, frame.rows, strict=True):
            position, rotation = (part[f] for part in root_motion(shot).frames(frame.time))
            carried = feather.rest.nodes[:, 0] @ rotation.T + position
            off = np.linalg.norm(rows[:, 0] - carried, axis=1).max()
            assert off < 0.1 * shot.groom.feathers[f].kind.length, names[f]


def test_the_last_shelter_that_fits_holds_and_patterns_must_fit(tmp_path: Path) -> None:
    shot = one_feather(1.0, 0.4)
    name = shot.groom.feathers[0].id
    both = replace(
        shot,
        shelters=(
            Shelter(share=0.4),
            Shelter(feathers=name, share=0.9),
            Shelter(feathers="none", share=0.1),
        ),
    )
    assert exposures(both) == pytest.approx(0.1)
    path = tmp_path / "shot.toml"
    groom = SAMPLES / "feather_pull" / "groom.toml"
    path.write_text(
        f"name = 's'\ngroom = '{groom}'\nframes = [1, 2]\n"
        "[[shelter]]\nregion = 'nowhere'\nshare = 0.5\n[[shelter]]\nshare = 2\n"
    )
    with pytest.raises(InputError) as caught:
        read_shot(path)
    text = "\n".join(map(str, caught.value.problems))
    assert "shelter[0].region: no region of the groom fits 'nowhere'" in text
    assert "shelter[1].share: 2 is out of range. Give 0 to 1" in text
