"""How much wind reaches feathers that lie on each other and on a skin, where no shot says it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.algebra.vectors import vectors_to_frames
from featherfx.groom.types import Placement
from featherfx.shot.frames import StageClock
from featherfx.shot.loads import exposures
from featherfx.shot.loop import shelter
from featherfx.shot.loop.shelter import LEAST, lying_exposures
from featherfx.shot.patterns import Shelter
from featherfx.shot.read.read import read_shot
from featherfx.shot.skin import SkinSurfaces
from featherfx.shot.types import part_of

SHOT = read_shot(SAMPLES / "feather_pull" / "shot.toml")
ONE = SHOT.groom.feathers[0]
LENGTH = ONE.kind.length
FAR = 2.0


class Sheet:
    """A level square from x = -1 to 1 that does not move."""

    path, st, sampled, bones, is_ribbon = "/sheet", None, None, None, False
    rest = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    triangles, face = np.array([[0, 1, 2], [0, 2, 3]]), np.array([0, 0])
    time_codes_per_second = 24.0

    def locate(self, triangle, barycentric):
        return self.face[triangle], self.triangles[triangle], barycentric


def at(x: float, height: float, turn: tuple[float, float, float] = (0, 0, 0)) -> Placement:
    """A feather whose root is at x on the sheet's middle line, in lengths, turned by rad."""
    rotation = vectors_to_frames(np.array([turn], dtype=float))[0]
    place = np.array([x, 0.0, height]) * LENGTH
    return replace(ONE, position=place, rotation=rotation, mirrored=False)


def exposed(*feathers: Placement) -> np.ndarray:
    placed = tuple(replace(each, id=f"{k}") for k, each in enumerate(feathers))
    groom = replace(SHOT.groom, feathers=placed)
    skin = SkinSurfaces((Sheet(),), StageClock(), 10.0, "", "").bind(groom)  # type: ignore[arg-type]
    return lying_exposures(placed, skin)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_vanes_on_each_other_bear_the_load_of_one(count: int) -> None:
    """Their shares of the air's force, e^2 each, add up to that of one, to a step of e."""
    found = exposed(*[at(0.0, FAR + 0.02 * k) for k in range(count)])
    np.testing.assert_allclose(found, np.sqrt(1.0 / count), atol=0.051)


def test_half_of_a_vane_under_another_bears_half_less() -> None:
    """The vane of one begins in the middle of the other's."""
    bare = ONE.kind.calamus
    found = exposed(at(0.0, FAR), at(0.5 * (1.0 - bare), FAR + 0.02))
    assert found.min() > 0.75
    assert found.max() < 0.98
    above, widths = at(0.0, FAR + 0.02), (ONE.kind.leading.outline, ONE.kind.trailing.outline)
    aside = 0.9 * sum(max(y for _, y in each) for each in widths)
    for away in ((2.0, 0.0), (0.0, aside)):
        beside = replace(above, position=above.position + LENGTH * np.array([*away, 0.0]))
        np.testing.assert_array_equal(exposed(at(0.0, FAR), beside), 1.0)


def test_feathers_over_the_skin_feel_least_and_those_beside_or_upright_all() -> None:
    upright = at(0.0, 0.01, (0.0, -0.5 * np.pi, 0.0))
    beyond = at(1.01 / LENGTH, 0.01)
    np.testing.assert_array_equal(exposed(at(0.0, 0.01)), LEAST)
    np.testing.assert_array_equal(exposed(beyond), 1.0)
    assert exposed(upright) > 0.8
    np.testing.assert_array_equal(exposed(at(0.0, FAR)), 1.0)


def test_left_and_right_are_as_exposed() -> None:
    kind = ONE.kind
    broad = replace(kind.leading, outline=((0.0, 0.2), (1.0, 0.2)))
    one = replace(at(0.0, FAR), kind=replace(kind, leading=broad))
    # beside it, over its broad vane alone
    other = replace(at(0.0, FAR + 0.01), position=np.array([0.0, 0.12, FAR + 0.01]) * LENGTH)
    right = exposed(one, other)
    mirror = np.array([1.0, -1.0, 1.0])
    left = exposed(*(replace(p, position=p.position * mirror, mirrored=True) for p in (one, other)))
    np.testing.assert_array_equal(left, right)
    assert right[0] < 1.0


def test_shelters_go_before_and_parts_of_a_shot_keep_what_the_whole_gives() -> None:
    feathers = tuple(replace(at(0.0, 0.02 * k), id=f"f{k}") for k in range(2))
    shot = replace(SHOT, grips=(), groom=replace(SHOT.groom, feathers=feathers))
    shot = replace(shot, exposure=np.array([0.2, 0.7]))
    np.testing.assert_array_equal(exposures(shot), [0.2, 0.7])
    np.testing.assert_array_equal(exposures(part_of(shot, np.array([1]))), [0.7])
    bare = replace(shot, shelters=(Shelter(feathers="f0", share=0.0),))
    np.testing.assert_array_equal(exposures(bare), [1.0, 0.7])


def test_what_was_found_once_is_kept_until_something_lies_otherwise(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path))
    lower, upper = at(0.0, FAR), at(0.5, FAR + 0.02)
    first = exposed(lower, upper)

    def anew(*_: object) -> None:
        raise AssertionError("computed anew")

    monkeypatch.setattr(shelter, "_lying", anew)
    np.testing.assert_array_equal(exposed(lower, upper), first)
    leading = replace(upper.kind.leading, outline=((0.0, 0.0), (0.5, 0.2), (1.0, 0.0)))
    others = (
        at(0.6, FAR + 0.02),
        at(0.5, FAR + 0.02, (0.1, 0.0, 0.0)),
        replace(upper, mirrored=True),
        replace(upper, kind=replace(upper.kind, leading=leading)),
    )
    for other in others:
        with pytest.raises(AssertionError, match="anew"):
            exposed(lower, other)
    monkeypatch.setattr(Sheet, "rest", Sheet.rest + 0.01)
    with pytest.raises(AssertionError, match="anew"):
        exposed(lower, upper)
