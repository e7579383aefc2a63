"""Vanes that are hooked in part: stiffness follows the share, mass and area do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.feather.build import build_feather
from featherfx.feather.profiles import hooked_stiffness, in_series
from featherfx.groom.presets.kinds import blended
from featherfx.groom.types import Hooked
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import MIN_HOOKED, make_model
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.vane_hook_kernels import all_hold
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state

WHOLE = feather_kind("swan_primary")


def kind_with(shaft=(), barb=(), hooks="closed"):
    """The swan's primary, its trailing vane hooked by so much."""
    vane = replace(WHOLE.trailing, hooked=Hooked(shaft, barb))
    material = replace(WHOLE.vane_material, hooks=hooks)
    return replace(WHOLE, trailing=vane, vane_material=material)


def model_of(kind):
    return make_model([build_feather(kind, 13, 4)], [kind], 1)


def test_stiffness_is_the_share_of_what_is_hooked_and_masses_stay():
    whole, half = model_of(WHOLE), model_of(kind_with(shaft=((0.0, 0.5),), barb=((0.0, 0.5),)))
    for name in ("cell_stiffness", "hinge_stiffness"):
        ours, theirs = getattr(half, name)[0], getattr(whole, name)[0]
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_allclose(ours[1], 0.25 * theirs[1], rtol=1e-14)
    np.testing.assert_array_equal(half.mass, whole.mass)
    np.testing.assert_array_equal(half.barb_stiffness, whole.barb_stiffness)


def test_the_curves_are_places_along_the_vane_and_along_the_barb():
    """Hooked beyond the middle of the vane, and of each barb its inner half."""
    kind = kind_with(shaft=((0.499999, 0.0), (0.5, 1.0)), barb=((0.5, 1.0), (0.500001, 0.0)))
    feather = build_feather(kind, 13, 4)
    whole, model = model_of(WHOLE), model_of(kind)
    ratio = model.cell_stiffness[0, 1, ..., 0] / np.where(feather.cell[1], 1.0, np.nan)
    ratio /= whole.cell_stiffness[0, 1, ..., 0]
    middle = 0.5 * (feather.station[1:] + feather.station[:-1]) / kind.length
    place = (middle - kind.calamus) / (1.0 - kind.calamus)
    expected = np.where((place > 0.5)[:, None] & (np.arange(4) < 2), 1.0, MIN_HOOKED)
    known = np.isfinite(ratio)
    expected = np.broadcast_to(expected[..., None], ratio.shape)
    np.testing.assert_allclose(ratio[known], expected[known], rtol=1e-9)


def test_strips_hang_one_on_the_next_whatever_the_rows():
    """Compliances add up: as much of the vane stretches alike on any rows, and where barbs of a
    strip are loose, none of it holds."""
    kind = kind_with(shaft=((0.3, 0.05), (0.7, 1.0)))
    found = []
    for rows in (7, 12, 41):
        feather = build_feather(kind, rows, 4)
        share = hooked_stiffness(kind, feather)[1, :, 0, 0]
        found.append((np.diff(feather.station) / kind.length / share).sum())
    ramp = 0.4 * np.log(20.0) / 0.95
    exact = kind.calamus / 0.05 + (1.0 - kind.calamus) * (0.3 / 0.05 + ramp + 0.3)
    assert found == pytest.approx([exact] * 3, rel=1e-12)
    # rows 0.1 of the vane apart, the strip from 0.6 to 0.7 loose in part
    ends = np.linspace(0.0, 1.0, 11)
    held = in_series(((0.61, 0.0), (0.65, 1.0)), ends)
    np.testing.assert_array_equal(held, np.where(ends[:-1] > 0.65, 1.0, 0.0))


def test_strength_and_its_energy_go_with_the_share_and_strains_at_yield_do_not():
    whole, half = model_of(kind_with(hooks="open")), model_of(kind_with(((0, 0.5),), hooks="open"))
    there = whole.cell_stiffness[0, 1, ..., 0] > 0.0
    for name, factor in (("limit", 0.5), ("release", 0.5), ("growth", 2.0)):
        ours, theirs = (getattr(m.hooks, name)[0, 1][there] for m in (half, whole))
        np.testing.assert_allclose(ours, factor * theirs, rtol=1e-12)


@pytest.mark.parametrize("strain", [0, 1])
def test_a_vane_is_taken_for_one_that_holds_only_while_each_gap_does(strain):
    """The weakest gap beyond its yield, one that has slipped, one that is open, or one crushed."""
    model = model_of(kind_with(hooks="open"))
    work = make_scratch(model)
    gaps, cell = work.around.gaps, work.now.strains.cell
    stiffness, limit = model.cell_stiffness[0, ..., strain], model.hooks.limit[0, ..., strain]
    yields = np.divide(limit, stiffness, out=np.full(limit.shape, np.inf), where=stiffness > 0.0)
    weakest = (*np.unravel_index(yields.argmin(), yields.shape), strain)
    for part, holds in ((0.999, True), (1.001, False)):
        cell[weakest] = part * yields.min()
        assert all_hold(model, 0, cell, gaps) == holds
    cell[weakest] = 0.0
    for array, value in ((gaps.slip, 1e-6), (gaps.hooked, 0.5), (cell, -0.4)):
        place = weakest[: array.ndim]
        array[place], usual = value, array[place]
        assert not all_hold(model, 0, cell, gaps)
        array[place] = usual
    assert all_hold(model, 0, cell, gaps)


def test_loose_barbs_bend_each_for_itself():
    """The end of one barb is pushed out of the vane: a hooked neighbour goes along."""
    moved = []
    for kind in (WHOLE, kind_with(barb=((0.0, 0.0),))):
        model = model_of(kind)
        state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        loads = no_loads(1)._replace(force=np.zeros((1, *model.mass.shape[1:], 3)))
        loads.force[0, 6, 8, 2] = 1e-3
        with Solver(model, Settings(newton=1e-9), 1) as solver:
            end = solver.equilibrium(state, loads)[0].points.nodes[0]
        up = (end - state.points.nodes[0])[:, :, 2]
        moved.append((up[7, 8] - up[7, 0]) / (up[6, 8] - up[6, 0]))
    assert moved[0] > 0.1
    assert abs(moved[1]) < 0.01


def test_blended_curves_lie_between_those_of_both_kinds():
    first, second = kind_with(((0.2, 0.0), (0.4, 1.0))), kind_with()
    curve = dict(blended(first, second, 0.5).trailing.hooked.rachis)
    assert curve == pytest.approx({0.2: 0.5, 0.4: 1.0})
    assert blended(first, second, 0.5).trailing.hooked.barb == ()
