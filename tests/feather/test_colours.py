"""Colours of feathers as functions of their own coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from trial_batches import preset_kind

from featherfx.feather.barb_looks import barb_curves
from featherfx.feather.build import build_feather
from featherfx.feather.colours import colour_feather
from featherfx.feather.types import RACHIS_PART
from featherfx.groom.materials import Colour, Pattern, linear
from featherfx.groom.presets.kinds import blended

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
KIND = preset_kind("swan_primary")


def shades(*patterns, rows=81, columns=16, mirrored=False, **colour):
    """Points (V, 3) m, st (V, 2), light (V,) of the vanes of a white feather; the feather."""
    kind = replace(KIND, colour=Colour(base=WHITE, patterns=patterns, **colour))
    feather = build_feather(kind, rows, columns, mirrored)
    found = colour_feather(kind, feather, None, "one")
    surface = feather.surface
    vane = np.setdiff1d(surface.triangles[surface.part != RACHIS_PART], [])
    points = surface.points(feather.rest)
    return points[vane], surface.st[vane], found.points[vane, 0], feather


def bar(**keys):
    return Pattern(colour=BLACK, **{"kind": "bars", "soft": 0.05, **keys})


def test_colours_are_light():
    assert linear(np.array([0.0, 0.04, 0.5, 1.0])) == pytest.approx(
        [0.0, 0.04 / 12.92, ((0.5 + 0.055) / 1.055) ** 2.4, 1.0]
    )


def test_bars_run_straight_across_a_feather_of_oblique_barbs():
    """At one distance along the shaft all of a flat feather is equally light, edge to edge."""
    flat = replace(KIND, rachis=replace(KIND.rachis, camber=0.0, sweep=0.0, twist=0.0))
    guides = [replace(g, curl=0.0, camber=0.0) for g in KIND.trailing.guides]
    kind = replace(
        flat,
        trailing=replace(KIND.trailing, guides=tuple(guides)),
        colour=Colour(base=WHITE, patterns=(bar(count=5, size=0.5),)),
    )
    feather = build_feather(kind, 201, 16)
    light = colour_feather(kind, feather, None, "one").points[:, 0]
    points = feather.surface.points(feather.rest)
    vane = np.unique(feather.surface.triangles[feather.surface.part != RACHIS_PART])
    along = (points[vane, 0] / kind.length - kind.calamus) / (1.0 - kind.calamus)
    inside = (along > 0.02) & (along < 0.98)
    phase = 5.0 * along[inside] % 1.0
    clear = np.abs(np.abs(phase - 0.5) - 0.25) > 0.05
    assert light[vane][inside][clear] == pytest.approx(
        np.where(np.abs(phase[clear] - 0.5) < 0.25, 0.0, 1.0), abs=1e-6
    )


def test_an_eye_is_round_and_a_fringe_follows_the_edge():
    points, st, light, feather = shades(bar(kind="eye", start=0.5, end=0.7, size=0.05))
    row = np.argmin(np.abs(feather.station / feather.station[-1] - (0.15 + 0.85 * 0.6)))
    centre = feather.rest.nodes[row, 0]
    distance = np.linalg.norm(points - centre, axis=1) / KIND.length
    assert light[distance < 0.045].max() < 1e-6
    assert light[distance > 0.058].min() > 1.0 - 1e-6
    _, st, light, _ = shades(bar(kind="fringe", size=0.01))
    share = np.abs(2.0 * st[:, 0] - 1.0)
    assert light[share == 1.0].max() < 1e-6
    middle = (share < 0.5) & (st[:, 1] > 0.3) & (st[:, 1] < 0.8)
    assert light[middle].min() > 1.0 - 1e-6


def test_a_gradient_rises_and_later_marks_cover_earlier_ones():
    _, st, light, _ = shades(bar(kind="gradient", start=0.2, end=0.9))
    shaft = st[:, 0] == 0.5
    assert (np.diff(light[shaft][np.argsort(st[shaft, 1])]) <= 1e-12).all()
    over = Pattern(kind="streak", colour=WHITE, size=1.0, soft=0.1)
    assert shades(bar(kind="gradient"), over)[2].min() == pytest.approx(1.0)


def test_mirrored_feathers_have_the_same_colours():
    marks = bar(count=4), Pattern(kind="spots", colour=(0.5, 0.2, 0.1), size=0.02)
    assert shades(*marks)[2] == pytest.approx(shades(*marks, mirrored=True)[2], abs=1e-9)


def test_barbs_have_the_colours_of_the_vane_below_them():
    kind = replace(KIND, colour=Colour(base=WHITE, patterns=(bar(count=2, soft=1.0),)))
    feather = build_feather(kind, 81, 16)
    barbs = barb_curves(kind, (81, 16), 60, False)
    found = colour_feather(kind, feather, barbs, "one")
    surface = feather.surface
    vane = np.unique(surface.triangles[surface.part != RACHIS_PART])
    points = surface.points(feather.rest)[vane]
    ends = barbs.points.reshape(-1, 3)[::7]
    near = np.linalg.norm(points - ends[:, None], axis=2).argmin(axis=1)
    assert found.barbs[::7, 0] == pytest.approx(found.points[vane[near], 0], abs=0.12)


def test_brightness_goes_by_the_id_alone():
    colour = Colour(base=(0.5, 0.5, 0.5), brightness_variation=0.1)
    kind = replace(KIND, colour=colour)
    feather = build_feather(kind, 9, 3)
    light = [colour_feather(kind, feather, None, f"f{k}").points[0, 0] for k in range(400)]
    again = colour_feather(kind, feather, None, "f7").points[0, 0]
    assert again == light[7]
    plain = float(linear(np.array(0.5)))
    assert np.mean(light) == pytest.approx(plain, rel=0.02)
    assert np.std(light) == pytest.approx(0.1 * plain, rel=0.1)


def test_halfway_kinds_have_halfway_colours():
    first = replace(KIND, colour=Colour(base=WHITE, patterns=(bar(count=4, size=0.2),)))
    second = replace(KIND, colour=Colour(base=(0.0, 0.5, 1.0), patterns=(bar(count=4, size=0.6),)))
    middle = blended(first, second, 0.25).colour
    assert middle.base == pytest.approx((0.75, 0.875, 1.0))
    assert middle.patterns == (bar(count=4, size=pytest.approx(0.3)),)
    # what only one has, and marks of other sorts, come from the nearer
    plain = blended(first, KIND, 0.25)
    assert plain.colour.base == WHITE
    assert blended(first, KIND, 0.75).colour == Colour()
    spots = replace(first, colour=replace(first.colour, patterns=(bar(kind="spots"),)))
    assert blended(first, spots, 0.75).colour.patterns == (bar(kind="spots"),)


@pytest.mark.parametrize("kind", ["bars", "spots", "fringe", "eye", "streak"])
def test_a_mark_without_a_size_leaves_most_of_a_feather_as_it_is(kind):
    _, _, light, _ = shades(bar(kind=kind))
    assert 0.01 < (light < 0.5).mean() < 0.5


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_slanted_bar_leans_to_the_tip_on_the_leading_vane(mirrored):
    flat = replace(KIND.rachis, camber=0.0, sweep=0.0, twist=0.0)
    sides = {
        side: replace(vane, guides=tuple(replace(g, curl=0.0, camber=0.0) for g in vane.guides))
        for side, vane in (("leading", KIND.leading), ("trailing", KIND.trailing))
    }
    mark = bar(start=0.4, end=0.6, count=1, size=1.0, slant=30.0)
    kind = replace(KIND, rachis=flat, colour=Colour(base=WHITE, patterns=(mark,)), **sides)
    feather = build_feather(kind, 201, 16, mirrored)
    surface = feather.surface
    vane = np.unique(surface.triangles[surface.part != RACHIS_PART])
    points = surface.points(feather.rest)[vane]
    beside = np.where(surface.st[vane, 0] > 0.5, 1.0, -1.0) * np.abs(points[:, 1])
    along = (points[:, 0] - np.tan(np.radians(30.0)) * beside) / kind.length
    off = np.abs((along - kind.calamus) / (1.0 - kind.calamus) - 0.5)
    clear = np.abs(off - 0.1) > 0.01
    light = colour_feather(kind, feather, None, "one").points[vane, 0]
    assert (off < 0.09).sum() > 100
    assert light[clear] == pytest.approx(np.where(off[clear] < 0.1, 0.0, 1.0), abs=1e-6)
