"""Levels that follow a camera: chosen by frame, changed without a pop, kept by checkpoints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.feather.types import RowPoints
from featherfx.shot.checkpoint import Checkpoint
from featherfx.shot.detail.changes import JUMP, Fades
from featherfx.shot.detail.followers import FeatherPose
from featherfx.shot.detail.levels import NUMBER, LevelPlan, level_plan
from featherfx.shot.detail.view import TimedCamera, View, relative_sizes
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import check_file, read_shot
from featherfx.shot.simulate import simulate
from featherfx.shot.types import Contact, LevelOfDetail, Motion, Shot

AXES = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Rail:
    """A camera that looks along x and stands at -distance(frame), one code a frame."""

    distance: tuple[float, ...]
    time_codes_per_second = 24.0
    origin = "/camera", ()

    def view(self, code: float) -> View:
        x = np.interp(code, np.arange(len(self.distance)), self.distance)
        return View(np.array([-x, 0.0, 0.0]), *AXES, 0.8, 0.45, (0.0, 0.0), False)


def rules(**values: object) -> LevelOfDetail:
    given = {
        "camera": None,
        "pixels_per_metre": 1e6,
        "image_height": 1080.0,
        "coarse_below": 0.0,
        "rachis_below": 0.0,
        "guided_below": 0.0,
        "rigid_below": 0.0,
        "outside": "rigid",
        "margin": 0.1,
        "motion": 0.0,
        "fade": 4,
    }
    return LevelOfDetail(**(given | values))


def feathers(count: int, frames: int, shake: float = 0.0) -> Shot:
    """Feathers side by side, hanging still or swinging, 13 rows."""
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    one = shot.groom.feathers[0]
    many = tuple(
        replace(one, id=f"f{k}", region="row", position=np.array([0.0, 0.02 * k, 0.0]))
        for k in range(count)
    )
    swing = {"amplitude": shake, "frequency": 2.0, "direction": (0.0, 0.0, 1.0), "rise": 0.25}
    return replace(
        shot,
        groom=replace(shot.groom, feathers=many),
        first_frame=0,
        last_frame=frames,
        frames_per_second=24.0,
        grips=(),
        gravity=np.array([0.0, 0.0, -9.81]),
        motion=Motion("shake", swing) if shake else Motion("hold", {}),
        wind=replace(shot.wind, speed=0.0, gust=0.0),
        quality=replace(shot.quality.pushing, rows=13, columns=3, coefficients=1, simulated_rows=0),
    )


def railed(shot: Shot, distance: tuple[float, ...], **values: object) -> Shot:
    return replace(shot, level_of_detail=rules(camera=TimedCamera(Rail(distance), 0.0), **values))


def names(shot: Shot) -> list[list[str]]:
    simulation = simulate(shot)
    plan = level_plan(shot, simulation.feathers, root_motion(shot))
    label = {number: level for level, number in NUMBER.items()}
    return [[label[int(each)] for each in row] for row in plan.table]


def test_without_changes_the_result_is_the_same_bytes() -> None:
    shot = feathers(2, 3, 0.03)
    seen = replace(shot, level_of_detail=rules())
    for frame, other in zip(simulate(seen), simulate(shot), strict=True):
        for one, two in zip(
            (*frame.points, *frame.velocities), (*other.points, *other.velocities), strict=True
        ):
            assert one.tobytes() == two.tobytes()


def test_sizes_in_the_picture() -> None:
    """A ball of the feather's length: length / (depth height), 0 where no part can be seen."""
    view = Rail((0.0, 0.0)).view(0.0)
    roots = np.array([(10, 0, 0), (10, 4.4, 0), (10, 9, 0), (-1, 0, 0), (-0.1, 0, 0)], dtype=float)
    lengths = np.array([0.5, 0.5, 0.5, 0.5, 0.5])
    found = relative_sizes(view, roots, lengths, 0.0)
    assert found[:2] == pytest.approx(0.5 / (10.0 * 0.45))
    assert found[2:4].tolist() == [0.0, 0.0]
    assert found[4] == pytest.approx(1.0 / 0.45)
    # the rim at 10 m is at 4 m and the feather 0.5 m long; an eighth of the width is 1 m
    beside = np.array([(10.0, -5.4, 0.0)])
    assert relative_sizes(view, beside, lengths[:1], 0.0)[0] == 0.0
    assert relative_sizes(view, beside, lengths[:1], 0.125)[0] > 0.0
    flat = replace(view, orthographic=True, width=2.0, height=1.0)
    assert relative_sizes(flat, roots[:3], lengths[:3], 0.0).tolist() == [0.5, 0.0, 0.0]


def test_levels_follow_the_camera_and_are_there_before_they_are_needed() -> None:
    far, near = 1000.0, 2.0
    distance = (far,) * 20 + (near,) * 10 + (far,) * 15
    shot = railed(feathers(1, 44), distance, coarse_below=60.0, rigid_below=10.0, fade=4)
    levels = [row[0] for row in names(shot)]
    assert levels == ["rigid"] * 16 + ["full"] * 18 + ["rigid"] * 11


def test_frames_without_end_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FEATHERFX_MEMORY", "0.5")
    shot = replace(feathers(2, 1_000_000), level_of_detail=rules(coarse_below=1.0))
    with pytest.raises(InputError, match="level_of_detail: levels of 2 feathers in 1000001 frames"):
        simulate(shot)


def test_motion_makes_feathers_count_for_more() -> None:
    still, moving = feathers(1, 8), feathers(1, 8, 0.05)
    length = still.groom.feathers[0].kind.length
    at = {"pixels_per_metre": 50.0 / length, "rigid_below": 60.0, "motion": 1.0}
    assert names(replace(still, level_of_detail=rules(**at)))[4] == ["rigid"]
    assert names(replace(moving, level_of_detail=rules(**at)))[4] == ["full"]
    assert names(replace(moving, level_of_detail=rules(**at | {"motion": 0.0})))[4] == ["rigid"]


def test_a_change_adds_less_than_the_bound_however_far_levels_are_apart() -> None:
    """What is shown moves by the levels' own motion, in the shares of before, and dw (b - a)."""
    length, per_frame = 0.2, 2
    fades = Fades(
        LevelPlan(
            np.array([[0]] + [[4]] * 500, dtype=np.int8), (), np.zeros(1, dtype=bool), np.zeros(1)
        ),
        np.array([length]),
        4,
        per_frame,
        1.0 / 48.0,
    )
    rng = np.random.default_rng(2)
    now = np.zeros((2, 5, 4, 3))
    now[1] += 0.05
    still = np.zeros((5, 2, 3))
    shares, added = [0.0], []
    while fades.now[0] == 0:
        fades.begin(len(shares))
        before, now = now, now + rng.normal(0.0, 1e-4, now.shape)
        poses = {
            (0, level): FeatherPose(
                *(RowPoints(part, still) for part in (each, 0 * each, 0 * each))
            )
            for level, each in zip((0, 4), now, strict=True)
        }
        if fades.fading.size:
            fades.grow([0], poses)
            w = shares[-1]
            shown = (1.0 - w) * before[0] + w * before[1]
            own = (1.0 - w) * (now[0] - before[0]) + w * (now[1] - before[1])
            jump = fades.blended(0, poses).points.nodes - shown - own
            added.append(np.linalg.norm(jump, axis=-1).max())
            shares.append(float(fades.weight[0]))
        assert len(shares) < 500
    assert shares[-1] == 1.0
    assert max(added) <= JUMP * length / per_frame * (1.0 + 1e-9)
    # it takes as long as the distance asks for: 0.0866 m at 0.4 mm a sample
    assert len(added) == pytest.approx(0.0866 / 4e-4, rel=0.05)


@pytest.mark.parametrize("level", ["coarse", "rachis", "rigid"])
def test_a_hanging_feather_changes_without_a_pop(level: str) -> None:
    """Nothing moves but the change itself, both ways: under 0.5 % of the length a frame.

    Under twenty gravities the feather sags by more than 3 % of its length.
    """
    near, far = 1.0, 60.0
    shot = replace(feathers(1, 90), gravity=np.array([0.0, 0.0, -200.0]))
    below = {f"{level}_below": 40.0}
    away = railed(shot, (near,) * 8 + (far,) * 35 + (near,) * 60, **below)
    assert {"full", level} == {row[0] for row in names(away)}
    full = next(iter(simulate(shot))).poses[0].points.nodes
    length = shot.groom.feathers[0].kind.length
    points = np.stack([frame.poses[0].points.nodes for frame in simulate(away)])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=(1, 2))
    assert steps.max() < 0.005 * length
    apart = np.linalg.norm(points - full, axis=-1).max()
    assert apart > {"coarse": 2e-4, "rachis": 2e-3, "rigid": 0.03}[level] * length
    assert points[-1] == pytest.approx(full, abs=5e-3 * length)


def test_guided_and_rigid_by_size_with_motion() -> None:
    distance = (1.0,) * 6 + tuple(np.linspace(2.0, 200.0, 14)) + (1.0,) * 20
    shot = railed(
        feathers(6, 36, 0.01), distance, coarse_below=120.0, guided_below=80.0, rigid_below=15.0
    )
    used = {level for row in names(shot) for level in row}
    assert {"full", "guided", "rigid"} <= used
    frames = list(simulate(shot))
    full = list(simulate(replace(shot, level_of_detail=None)))
    for frame, other in zip(frames, full, strict=True):
        for one, two in zip(frame.points, other.points, strict=True):
            assert np.isfinite(one).all()
            assert np.abs(one - two).max() < 0.03
    assert frames[0].points[0].tobytes() == full[0].points[0].tobytes()


def test_a_resumed_fade_goes_on_as_it_would_have(tmp_path: Path) -> None:
    distance = (1.0,) * 4 + (60.0,) * 12 + (1.0,) * 12
    shot = railed(feathers(3, 20, 0.02), distance, coarse_below=70.0, guided_below=40.0)
    whole = list(simulate(shot))
    simulation = simulate(shot)
    for frame in simulation:
        if frame.number in (3, 9, 14):
            simulation.checkpoint().save(tmp_path / f"{frame.number}.npz")
    for number in (3, 9, 14):
        start = Checkpoint.load(tmp_path / f"{number}.npz")
        rest = list(simulate(shot, frames=(number + 1, 20), start=start))
        for frame, other in zip(rest, whole[number + 1 :], strict=True):
            for one, two in zip(frame.points, other.points, strict=True):
                assert one.tobytes() == two.tobytes()


def test_wrong_tables_are_told(tmp_path: Path) -> None:
    (tmp_path / "groom.toml").write_text((SAMPLES / "feather_pull" / "groom.toml").read_text())
    text = (SAMPLES / "feather_pull" / "shot.toml").read_text()
    for table, key in (
        ("", "level_of_detail"),
        ('usd = "a.usda"', "level_of_detail.prim"),
        ('usd = "a.usda"\nprim = "/c"\npixels_per_metre = 9', "level_of_detail"),
        ("pixels_per_metre = 9\nfade = 0", "level_of_detail.fade"),
        ('pixels_per_metre = 9\noutside = "none"', "level_of_detail.outside"),
    ):
        (tmp_path / "shot.toml").write_text(f"{text}\n[level_of_detail]\n{table}\n")
        assert [problem.key for problem in check_file(tmp_path / "shot.toml")] == [key]


def lying(frames: int) -> Shot:
    """One feather pressed on another, both held at their roots; the camera backs away at once and
    comes back."""
    shot = feathers(2, frames)
    below, above = shot.groom.feathers
    c, s = np.cos(0.004), np.sin(0.004)
    dive = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    place = below.position + np.array([0.0, 0.0, 1e-3])
    above = replace(above, position=place, rotation=above.rotation @ dive)
    shot = replace(
        shot,
        groom=replace(shot.groom, feathers=(below, above)),
        quality=replace(shot.quality.pushing, rows=11),
        contact=Contact(thickness=5e-4),
    )
    distance = (2.0,) * 3 + (1000.0,) * 8 + (2.0,) * frames
    return railed(shot, distance, coarse_below=60.0, fade=2)


def test_feathers_in_contact_change_their_level_without_a_pop(tmp_path: Path) -> None:
    shot = lying(14)
    levels = [row[0] for row in names(shot)]
    assert {"full", "coarse"} == set(levels)
    simulation = simulate(shot)
    frames = list(simulation)
    length = shot.groom.feathers[0].kind.length
    ways = [
        np.abs(now.points[f] - before.points[f]).max()
        for before, now in pairwise(frames)
        for f in range(2)
    ]
    # both hang still, but for the change
    assert 0.0 < max(ways) < 2.0 * JUMP * length
    contact = simulation.report["contact"]
    assert contact["most_contacts"] > 0
    # of the thickness; were each level to touch both of the other feather's, a half of it
    assert contact["worst_depth"] < 0.2 * 5e-4
    begun = simulate(shot, frames=(0, 5))
    for _ in begun:
        pass
    begun.checkpoint().save(tmp_path / "state.npz")
    resumed = simulate(shot, start=Checkpoint.load(tmp_path / "state.npz"))
    for frame, other in zip(frames[6:], resumed, strict=True):
        assert all(
            a.tobytes() == b.tobytes() for a, b in zip(frame.points, other.points, strict=True)
        )
