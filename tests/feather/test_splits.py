"""Vanes that are split from the start: where they gape, and what lies beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.feather.build import build_feather, mirror_feather
from featherfx.feather.splits import SplitEdges
from featherfx.feather.types import TRAILING, scale_feather
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.splits import splits_of
from featherfx.groom.types import Splits
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.solver.state import rest_state

WHOLE = feather_kind("swan_primary")


def split(**values):
    """The swan's primary with splits in its trailing vane."""
    return replace(WHOLE, trailing=replace(WHOLE.trailing, splits=Splits(**values)))


ONE = split(places=((0.5, 0.6),), width=0.01)


def across(vectors, along):
    """Lengths of vectors (L, 3) without what lies along others."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.linalg.norm(np.cross(vectors, along), axis=1)


def gape(feather, node):
    """(L,) m, from lips that are open at rest across to the barbs above them, at a node."""
    lips = SplitEdges.from_feather(feather)
    open_ = lips.open(np.where(feather.split, 0.0, 1.0)) & (lips.node == node)
    above = feather.rest.nodes[lips.row[open_] + 1, node - 1 : node + 1]
    return across(above[:, 1] - lips.positions(feather.rest)[open_], above[:, 1] - above[:, 0])


@pytest.mark.parametrize(("rows", "within"), [(15, 0.2), (41, 0.1)])
def test_a_split_gapes_by_its_width_at_the_edge_and_less_within(rows, within):
    feather = build_feather(ONE, rows, 6)
    assert feather.split[TRAILING].any(axis=(1, 2)).sum() == 1
    assert not feather.split[0].any()
    (at_edge,), (inner,) = gape(feather, 12), gape(feather, 10)
    assert at_edge == pytest.approx(0.01 * WHOLE.length, rel=within)
    assert 0.2 * at_edge < inner < 0.7 * at_edge


def test_depth_counts_from_the_edge():
    """The outer six tenths of ten columns."""
    own = build_feather(ONE, 21, 10).split[TRAILING]
    row = np.flatnonzero(own.any(axis=(1, 2)))[0]
    np.testing.assert_array_equal(own[row].all(axis=1), np.arange(10) >= 4)


def test_other_barbs_stay_and_keep_their_lengths():
    feather, whole = build_feather(ONE, 41, 4), build_feather(WHOLE, 41, 4)
    np.testing.assert_array_equal(feather.unsplit, whole.rest.nodes)
    way = feather.rest.nodes - whole.rest.nodes
    moved = across(way[:, 8], whole.rest.nodes[:, 8] - whole.rest.nodes[:, 7] + 1e-9)
    assert moved.max() == pytest.approx(0.5 * 0.01 * WHOLE.length, rel=0.1)
    assert (moved > 0.0).sum() < 20
    assert np.abs(way[:, :5]).max() == 0.0
    long = whole.barb_length[1] > 0.02
    np.testing.assert_allclose(feather.barb_length[1][long], whole.barb_length[1][long], rtol=0.05)


def test_mirrored_and_larger_feathers_have_the_same_splits():
    feather = build_feather(ONE, 21, 4)
    other = scale_feather(mirror_feather(feather), 2.0)
    np.testing.assert_array_equal(other.split, feather.split)
    np.testing.assert_allclose(gape(other, 8), 2.0 * gape(feather, 8), rtol=1e-12)


def test_splits_start_open_and_their_barbs_meet_where_they_were_joined():
    feather = build_feather(ONE, 21, 4)
    model = make_model([feather], [ONE], 1)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    own = state.gaps_of(0)
    np.testing.assert_array_equal(own.hooked == 0.0, feather.split)
    assert (own.level[~feather.split] == 1.0).all()
    nearest = own.level[feather.split]
    assert ((nearest > 0.1) & (nearest < 0.9)).any()
    assert (nearest <= 1.0).all()


def test_drawn_splits_are_the_same_for_a_pattern_and_differ_between_patterns():
    kind = split(count=5, where=(0.2, 0.8))
    patterns = [adjusted(kind, Change(patterns=(0, k))).trailing.splits for k in (0, 1, 1)]
    drawn = [splits_of(each, TRAILING) for each in patterns]
    assert drawn[1] == drawn[2] != drawn[0]
    for each in drawn:
        assert len(each) == 5
        assert all(0.2 < one.position < 0.8 for one in each)
        assert np.diff([one.position for one in each]).min() > 0.3 * 0.6 / 5
    even = splits_of(split(count=3, irregularity=0.0, where=(0.2, 0.8)).trailing.splits, TRAILING)
    assert [one.position for one in even] == pytest.approx([0.3, 0.5, 0.7])


@pytest.mark.parametrize("rows", [11, 21, 61])
def test_many_splits_on_any_grid_do_not_fold_the_vane(rows):
    feather = build_feather(split(count=12, width=0.008, irregularity=1.0), rows, 4)
    strips = feather.split[TRAILING].any(axis=(1, 2)).sum()
    assert strips == 12 if rows == 61 else strips > 4
