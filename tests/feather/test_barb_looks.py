"""Looks of barbs that are drawn: linear in the feather's points, so that they follow its motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES
from scipy.spatial.transform import Rotation
from trial_batches import preset_kind

from featherfx import read_groom
from featherfx.errors import InputError
from featherfx.feather.barb_looks import barb_curves, drawn_barbs
from featherfx.feather.build import build_feather
from featherfx.feather.types import both
from featherfx.groom.materials import BarbLook

KIND = preset_kind("swan_primary")
GRID, COUNT = (11, 4), 60
GROOM = "swan_wing/groom.toml"


def drawn(id="one", mirrored=False, **look):
    kind = replace(KIND, barbs=BarbLook(**look))
    return drawn_barbs(kind, GRID, COUNT, mirrored, id)


PLAIN = barb_curves(KIND, GRID, COUNT, False)
LOOK = {"clump": 0.7, "clump_count": 6, "frizz": 1e-3, "jitter": 0.3}


@pytest.mark.parametrize("mirrored", [False, True])
def test_at_rest_and_in_rigid_motion_barbs_are_those_that_were_drawn(mirrored):
    barbs = drawn(mirrored=mirrored, **LOOK)
    rest = build_feather(KIND, *GRID, mirrored).rest
    assert barbs.points_map(rest) == pytest.approx(barbs.points, abs=1e-12)
    turn = Rotation.from_rotvec([0.3, -1.1, 2.0])
    moved = both(lambda part: part @ turn.as_matrix().T, rest)
    moved = moved.shifted(np.array([1.0, 2.0, 3.0]))
    expected = turn.apply(barbs.points.reshape(-1, 3)) + np.array([1.0, 2.0, 3.0])
    assert barbs.points_map(moved).reshape(-1, 3) == pytest.approx(expected, abs=1e-10)


def test_roots_stay_on_the_shaft():
    assert drawn(**LOOK).points[:, 0] == pytest.approx(PLAIN.points[:, 0], abs=1e-12)


def test_clumps_bring_ends_together_and_leave_their_middles():
    barbs = drawn(clump=1.0, clump_count=5)
    ends = np.unique(np.round(barbs.points[:, -1], 9), axis=0)
    assert len(ends) == 10  # of either vane
    shared = {tuple(each) for each in np.round(PLAIN.points[:, -1], 9)}
    assert all(tuple(each) in shared for each in ends)
    half = drawn(clump=0.5, clump_count=5)
    assert half.points == pytest.approx(0.5 * (barbs.points + PLAIN.points), abs=1e-12)


def test_jitter_shortens_and_keeps_the_way():
    barbs = drawn(jitter=0.5)

    def length(points):
        return np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)

    left = length(barbs.points) / length(PLAIN.points)
    assert left.max() <= 1.0 + 1e-9
    assert left.min() < 0.6
    assert left.min() > 0.49
    inner = np.abs(2.0 * barbs.st[:, -1, 0] - 1.0)
    assert inner == pytest.approx(left, abs=0.02)


def test_frizz_goes_as_far_as_it_says():
    away = np.linalg.norm(drawn(frizz=1e-3, frizz_waves=1.5).points - PLAIN.points, axis=2)
    # the two ways are nearly square to each other
    assert away.max() <= 2.0 * 1e-3
    assert away.max() > 1e-3
    assert away[:, 0].max() == 0.0


def test_feathers_of_other_ids_have_other_draws_that_stay():
    first, again = (drawn("one", **LOOK).points for _ in range(2))
    assert np.array_equal(first, again)
    draws = {drawn(f"f{k}", **LOOK).points.tobytes() for k in range(60)}
    assert len(draws) == 8
    same = {drawn(f"f{k}", variants=1, **LOOK).points.tobytes() for k in range(5)}
    assert len(same) == 1


def test_as_many_barbs_as_fold_are_refused_by_their_number():
    kinds = {each.kind.name: each.kind for each in read_groom(SAMPLES / GROOM).feathers}
    with pytest.raises(InputError) as caught:
        barb_curves(kinds["swan_secondary"], GRID, 10_000, False)
    (problem,) = caught.value.problems
    assert problem.key == "barbs"
    assert problem.message.startswith("with 10000 along a vane, as asked for, neighbouring barbs")
