"""Feathers that are wet at times: heavier, with weaker hooks, through which more air goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES
from pxr import Sdf, Usd, UsdGeom

from featherfx import bake
from featherfx.errors import InputError
from featherfx.feather.barb_looks import barb_curves, clumped
from featherfx.feather.build import build_feather
from featherfx.mechanics.batch import make_model, vane_mass
from featherfx.mechanics.model import no_loads
from featherfx.render.camera import axes_of, framing
from featherfx.render.geometry import load_points
from featherfx.render.light_kernels import VANE
from featherfx.render.options import PictureOptions
from featherfx.render.subject import open_subject
from featherfx.shot.loop.hooks import Water, clumping
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import motion_dependences
from featherfx.shot.patterns import Wet, last_fitting
from featherfx.shot.read.read import read_shot
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.expand import expand

SAMPLE = SAMPLES / "wet_feather"
SOAKED = Wet(feathers="wet", keys=((0.0, 1.0),))


@pytest.fixture(scope="module")
def shot():
    """The sample on a coarse grid."""
    read = read_shot(SAMPLE / "shot.toml")
    quality = replace(read.quality.pushing, rows=11, columns=3, coefficients=1, simulated_rows=0)
    return replace(read, quality=quality)


def test_water_is_mass_of_the_vane_and_weakens_hooks_and_air(shot):
    placement = shot.groom.feathers[0]
    material = replace(placement.kind.vane_material, hooks="open")
    placement = replace(placement, kind=replace(placement.kind, vane_material=material))
    feather = build_feather(placement.kind, 11, 3)
    dry = make_model([feather], [placement.kind], 1)
    rule = Wet(keys=((0.0, 0.0), (1.0, 1.0)), water=1.5, hooks=0.4, drag=0.6)
    water = Water(rule, [feather], [placement])
    assert not water.renew(None, 0.0, 0.0)
    assert water.renew(None, 0.0, 0.5)
    model = water.model(dry)
    area = np.linalg.norm(np.cross(*_edges(feather)), axis=1).sum() / 2.0
    added = (model.mass - dry.mass).sum()
    assert added == pytest.approx(0.75 * material.surface_density * area, rel=1e-12)
    assert vane_mass(feather, placement.kind).sum() == pytest.approx(added / 0.75)
    np.testing.assert_allclose(model.hooks.limit, 0.7 * dry.hooks.limit)
    np.testing.assert_allclose(model.hooks.release, 0.7 * dry.hooks.release)
    loads = no_loads(1)._replace(air=np.array([1.2, 1.0, 0.1, 1.1]))
    np.testing.assert_allclose(water.added(loads, None, 0.0, 0.5).air, [1.2, 0.8, 0.08, 1.1])


def _edges(feather):
    """Two edges (T, 3) of every triangle of the vanes."""
    surface = feather.surface
    corners = surface.points(feather.rest)[surface.triangles[surface.part != 2]]
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def test_a_wet_feather_hangs_lower_beside_a_dry_one(shot):
    """Of two equal ones that lie level in still air, by the weight of the water."""
    lying = tuple(replace(each, rotation=np.eye(3)) for each in shot.groom.feathers)
    calm = replace(
        shot,
        groom=replace(shot.groom, feathers=lying),
        wind=replace(shot.wind, speed=0.0),
        wets=(SOAKED,),
        last_frame=shot.first_frame,
    )
    (frame,) = simulate(calm)
    rest = build_feather(shot.groom.feathers[0].kind, 11, 3).rest.nodes
    dry, wet = (pose.points.nodes[-1, 0, 2] - rest[-1, 0, 2] for pose in frame.poses)
    assert wet < 1.1 * dry < 0.0
    assert [pose.clumped for pose in frame.poses] == [(0.0, 1), (0.8, 24)]


def test_drying_wakes_a_feather_at_rest_and_goes_on_from_a_checkpoint_to_the_bit(shot):
    drying = replace(
        shot,
        wind=replace(shot.wind, speed=0.0),
        wets=(replace(SOAKED, keys=((0.1, 1.0), (0.2, 0.0))),),
        last_frame=shot.first_frame + 8,
    )
    simulation, points = simulate(drying), []
    for frame in simulation:
        points.append(frame.rows[1])
        if frame.number == shot.first_frame + 4:
            kept = simulation.checkpoint()
    assert np.abs(points[-1] - points[0]).max() > 1e-5
    rest = [frame.rows[1] for frame in simulate(drying, start=kept)]
    np.testing.assert_array_equal(points[5:], rest)


def test_the_last_rule_that_fits_holds_and_only_its_feathers_depend_on_it(shot):
    two = replace(shot, wets=(SOAKED, Wet(keys=((0.0, 0.5),), clump=1.0)))
    assert last_fitting(shot.wets, shot.groom.feathers) == [-1, 0]
    assert last_fitting(two.wets, two.groom.feathers) == [1, 1]
    assert clumping(two, 1, 3.0) == (0.5, 24)
    before, after = motion_dependences(replace(shot, wets=())), motion_dependences(shot)
    assert before[0] == after[0]
    assert before[1] != after[1]


def test_barbs_come_together_at_their_ends_and_stay_at_their_roots(shot):
    barbs = barb_curves(shot.groom.feathers[0].kind, (11, 3), 60, False)
    points = barbs.points.reshape(-1, 3)
    together = clumped(barbs, points, 0.8, 6).reshape(barbs.points.shape)
    np.testing.assert_array_equal(together[:, 0], barbs.points[:, 0])
    assert clumped(barbs, points, 0.0, 6) is points
    own = barbs.side == 0
    for k, narrower in ((-1, 0.5), (4, 0.9)):
        before, after = (
            np.linalg.norm(np.diff(each[own][:, k], axis=0), axis=1)
            for each in (barbs.points, together)
        )
        assert np.median(after) < narrower * np.median(before)
    ends = np.linalg.norm(np.diff(together[own][:, -1], axis=0), axis=1)
    assert (ends > 3.0 * np.median(ends)).sum() == 5


def test_a_cache_tells_how_wet_its_feathers_are_and_pictures_draw_it(tmp_path):
    (tmp_path / "groom.toml").write_text((SAMPLE / "groom.toml").read_text())
    text = (SAMPLE / "shot.toml").read_text()
    changes = ("[1, 48]", "[1, 3]"), ('"preview"', '"draft"'), ("[1.0, 1], [2.0", "[0, 1], [0.1")
    for before, after in changes:
        text = text.replace(before, after)
    (tmp_path / "shot.toml").write_text(text)
    path = tmp_path / "wet.usda"
    bake(tmp_path / "shot.toml", path, overwrite=True, form="both", barbs=30)
    cache = Cache(path)
    for frame, wet in ((1.0, 1.0), (3.0, 1.0 - 0.7 / 0.1 * 2.0 / 24.0)):
        told = cache.clumped_of([1, 0], frame)
        np.testing.assert_allclose(told, [[0.8 * wet, 24.0], [0.0, 0.0]], rtol=1e-6)
    _check_condensed(path, cache)
    subject = open_subject(tmp_path / "wet.usda", PictureOptions())
    right, up = axes_of("side", *subject.shape())
    reach = np.concatenate([hull for _, hull in subject.whole_reach])
    subject.colour(framing(right, up, reach, (600, 400)), [1.0], "shaded")
    drawn = subject.geometry(1.0)
    dry = subject.plumage.geometry(load_points(cache, subject.scene, 1.0))
    tip = drawn.barbs[:, 1] == 1.0
    assert not tip[np.unique(drawn.triangles[drawn.material != VANE])].any()
    apart = [np.linalg.norm(np.diff(each.points[tip], axis=0), axis=1) for each in (dry, drawn)]
    nearer = np.divide(apart[1], apart[0], out=np.ones_like(apart[0]), where=apart[0] > 0.0)
    # the feathers stand side by side along y; within a clump a fifth of the way is left
    wet = dry.points[tip][1:, 1] < 0.0
    assert np.median(nearer[wet]) == pytest.approx(0.2, rel=1e-3)
    np.testing.assert_array_equal(
        drawn.points[drawn.points[:, 1] > 0.0], dry.points[dry.points[:, 1] > 0.0]
    )


def _check_condensed(path, meshes):
    """Without its meshes a cache tells of the same clumps, and the same barbs are made of it."""
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))
    curves = [each for each in stage.Traverse() if each.IsA(UsdGeom.BasisCurves)]
    drawn = [UsdGeom.BasisCurves(each) for each in curves if "barbs" in each.GetName()]
    expansion = expand(path, barbs=30)
    for frame in (1.0, 3.0):
        written = np.concatenate([each.GetPointsAttr().Get(frame) for each in drawn])
        made = expansion.barbs(frame).reshape(-1, 3)
        assert np.abs(made - written).max() < 1e-5
    told = [meshes.clumped_of([1, 0], frame) for frame in (1.0, 3.0)]
    for each in meshes.feathers:
        stage.RemovePrim(each.path)
    stage.Export(str(path.with_name("condensed.usda")))
    condensed = Cache(path.with_name("condensed.usda"))
    found = [condensed.clumped_of([1, 0], frame) for frame in (1.0, 3.0)]
    np.testing.assert_array_equal(found, told)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("[[0, 1.5]]", r"keys\[0\]\[1\]: 1.5 is out of range. Give 0 to 1"),
        ("[[1, 0], [1, 1]]", r"keys\[1\]: 1 s is not later than 1 s"),
        ("[]", "has 0 items"),
    ],
)
def test_bad_wetness_is_told(tmp_path, keys, message):
    (tmp_path / "groom.toml").write_text((SAMPLE / "groom.toml").read_text())
    text = (SAMPLE / "shot.toml").read_text()
    (tmp_path / "shot.toml").write_text(text.replace("[[1.0, 1], [2.0, 0.3]]", keys))
    with pytest.raises(InputError, match=message):
        read_shot(tmp_path / "shot.toml")
