"""Levels by the size of feathers in the image of a camera, chosen once for a shot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.shot.frames import StageClock
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import check_file, read_shot
from featherfx.shot.sources import TimedCamera, View, relative_sizes
from featherfx.shot.types import LevelOfDetail, Motion, Shot

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
    swing = {
        "amplitude": shake,
        "frequency": 2.0,
        "direction": (0.0, 0.0, 1.0),
        "ramp_periods": 0.25,
    }
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
    return replace(
        shot,
        level_of_detail=rules(
            camera=TimedCamera(Rail(distance), StageClock(0.0, 1.0, 24.0)), **values
        ),
    )


def levels(shot: Shot) -> list[str]:
    return [each.level for each in simulate(shot).options]


def test_without_changes_the_result_is_the_same_bytes() -> None:
    shot = feathers(2, 3, 0.03)
    seen = replace(shot, level_of_detail=rules())
    for frame, other in zip(simulate(seen), simulate(shot), strict=True):
        for one, two in zip(
            (*frame.rows, *frame.row_velocities), (*other.rows, *other.row_velocities), strict=True
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


def test_the_largest_size_over_the_frames_chooses_one_level() -> None:
    """A feather that is near, or in the picture, in one frame has the level of that frame."""
    far, near = 1000.0, 2.0
    shot, below = feathers(1, 44), {"coarse_below": 60.0, "rigid_below": 10.0}
    assert levels(railed(shot, (far,) * 45, **below)) == ["rigid"]
    assert levels(railed(shot, (far,) * 20 + (near,) + (far,) * 24, **below)) == ["full"]
    assert levels(railed(shot, (12.0,) * 45, **below)) == ["coarse"]
    behind = (-50.0,) * 45
    assert levels(railed(shot, behind, **below, outside="rachis")) == ["rachis"]
    assert levels(railed(shot, (*behind[1:], near), **below)) == ["full"]


def test_frames_without_end_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FEATHERFX_MEMORY", "0.5")
    shot = replace(feathers(2, 1_000_000), level_of_detail=rules(coarse_below=1.0))
    with pytest.raises(InputError, match="level_of_detail: levels of 2 feathers in 1000001 frames"):
        simulate(shot)


def test_motion_makes_feathers_count_for_more() -> None:
    still, moving = feathers(1, 8), feathers(1, 8, 0.05)
    length = still.groom.feathers[0].kind.length
    at = {"pixels_per_metre": 50.0 / length, "rigid_below": 60.0, "motion": 1.0}
    assert levels(replace(still, level_of_detail=rules(**at))) == ["rigid"]
    assert levels(replace(moving, level_of_detail=rules(**at))) == ["full"]
    assert levels(replace(moving, level_of_detail=rules(**at | {"motion": 0.0}))) == ["rigid"]


def test_guided_and_rigid_by_size_stay_near_the_full_result() -> None:
    shot = feathers(6, 12, 0.01)
    full = list(simulate(shot))
    for below, level in (("guided_below", "guided"), ("rigid_below", "rigid")):
        seen = replace(shot, level_of_detail=rules(pixels_per_metre=100.0, **{below: 120.0}))
        simulation = simulate(seen)
        frames = list(simulation)
        assert level in {each.level for each in simulation.options}
        for frame, other in zip(frames, full, strict=True):
            for one, two in zip(frame.rows, other.rows, strict=True):
                assert np.abs(one - two).max() < 0.03


def test_wrong_tables_are_told(tmp_path: Path) -> None:
    (tmp_path / "groom.toml").write_text((SAMPLES / "feather_pull" / "groom.toml").read_text())
    text = (SAMPLES / "feather_pull" / "shot.toml").read_text()
    for table, key in (
        ("", "level_of_detail"),
        ('usd = "a.usda"', "level_of_detail.prim"),
        ('usd = "a.usda"\nprim = "/c"\npixels_per_metre = 9', "level_of_detail"),
        ("pixels_per_metre = 9\nfade = 8", "level_of_detail.fade"),
        ('pixels_per_metre = 9\noutside = "none"', "level_of_detail.outside"),
    ):
        (tmp_path / "shot.toml").write_text(f"{text}\n[level_of_detail]\n{table}\n")
        assert [problem.key for problem in check_file(tmp_path / "shot.toml")] == [key]
