"""Condensed feathers as a bake writes them, and meshes and barbs made of them again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import feathers
import numpy as np
import pytest
from places import SAMPLES
from pxr import Sdf, Usd, UsdGeom

import featherfx
from featherfx.algebra.vectors import about_x
from featherfx.baking.entries import drawn_entries, entries_of
from featherfx.baking.options import DrawnOptions
from featherfx.errors import InputError
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RowPoints, both
from featherfx.usd.check.check import check_usd
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.expand import expand
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

GRID = 11, 4
# what is kept of it, where condensed feathers stand alone
KEPT = 5, 2
# share of a feather's length that its mesh may be off then, as of one that is beside its mesh
WITHIN = {"both": 1e-5, "condensed": 0.65e-3}
CODES = (None, 1.0, 2.0)


@pytest.fixture(scope="module")
def entries():
    """Wing feathers of both sides."""
    groom = featherfx.read_groom(SAMPLES / "swan_wing/groom.toml")
    chosen = replace(groom, feathers=groom.feathers[::6])
    assert {each.mirrored for each in chosen.feathers} == {True, False}
    return entries_of(chosen, build_feathers(chosen.feathers, *GRID), static=False)


def bent(rest: RowPoints, number: int) -> RowPoints:
    """A feather whose rows turn about x the more the farther they are from its root."""
    start = rest.nodes[0, 0]
    along = np.linalg.norm(rest.nodes[:, 0] - start, axis=1)
    turns = np.stack([about_x(60.0 * number * each) for each in along])
    nodes = np.einsum("rkc,rdc->rkd", rest.nodes - start, turns) + start
    return RowPoints(nodes, np.einsum("rkc,rdc->rkd", rest.directors, turns))


def write(path: Path, entries, **options) -> Path:
    options = WriteOptions(up_axis="Y", meters_per_unit=0.01, **options)
    with CacheWriter(path, entries, (1, 2), 24.0, options) as writer:
        for number in (1, 2):
            points = [bent(each.rest_points, number) for each in entries]
            still = [both(np.zeros_like, each) for each in points]
            writer.write(feathers.frame_of(number, (number - 1) / 24, points, still))
    return path


@pytest.fixture(scope="module")
def baked(entries, tmp_path_factory):
    folder = tmp_path_factory.mktemp("forms")
    return {
        (form, group): write(folder / f"{form}_{group}.usdc", entries, form=form, group=group)
        for form, group in (
            ("mesh", "feather"),
            ("both", "feather"),
            ("condensed", "feather"),
            ("condensed", "all"),
        )
    }


def prims(stage, schema) -> list:
    return [each for each in stage.Traverse() if each.IsA(schema)]


@pytest.mark.parametrize(
    "form", [("both", "feather"), ("condensed", "feather"), ("condensed", "all")]
)
def test_condensed_feathers_expand_to_what_a_mesh_bake_writes(baked, form):
    meshes, expanded = Cache(baked["mesh", "feather"]), expand(baked[form])
    known = {each.id: number for number, each in enumerate(meshes.feathers)}
    assert {each.id for each in expanded.feathers} == set(known)
    for code in CODES:
        points = expanded.points(code)
        for own in expanded.feathers:
            mesh, wanted = meshes.feathers[known[own.id]], meshes.points(known[own.id], code)
            off = np.linalg.norm(points[own.points] - wanted, axis=1).max()
            np.testing.assert_array_equal(own.triangles, mesh.triangles)
            np.testing.assert_array_equal(own.side, mesh.side)
            np.testing.assert_allclose(own.st, mesh.st, atol=1e-3)
            assert (own.kind, own.region) == (mesh.kind, mesh.region)
            assert off < WITHIN[form[0]] * np.linalg.norm(np.ptp(wanted, axis=0))


def test_a_cache_of_condensed_feathers_is_read_as_meshes_and_found_sound(baked):
    for form in (("both", "feather"), ("condensed", "feather"), ("condensed", "all")):
        assert check_usd(baked[form]) == []
    one, other = Cache(baked["condensed", "all"]), Cache(baked["mesh", "feather"])
    assert one.codes() == other.codes() == [1.0, 2.0]
    assert [each.id for each in one.feathers] == [each.id for each in other.feathers]
    np.testing.assert_allclose(one.points(2, 2.0), other.points(2, 2.0), atol=0.02)
    assert set(one.feathers[0].subsets) == set(other.feathers[0].subsets)


def test_what_a_shaft_carries(baked, entries):
    stage = Usd.Stage.Open(str(baked["condensed", "all"]))
    (curves,) = prims(stage, UsdGeom.BasisCurves)
    assert not prims(stage, UsdGeom.Mesh)
    primvars, rows = UsdGeom.PrimvarsAPI(curves), KEPT[0] * len(entries)
    for end in "lr":
        for name in (f"P_barb{end}", f"uv_barb{end}", f"width_barb{end}", f"rest_barb{end}"):
            primvar = primvars.GetPrimvar(name)
            assert primvar.GetElementSize() == KEPT[1]
            assert primvar.GetInterpolation() == "vertex"
            assert len(primvar.Get()) == rows * KEPT[1]
        assert primvars.GetPrimvar(f"P_barb{end}").GetTimeSamples() == [1.0, 2.0]
        assert primvars.GetPrimvar(f"P_barb{end}").GetTypeName() == Sdf.ValueTypeNames.Point3fArray
    assert len(primvars.GetPrimvar("barborient").Get(1.0)) == rows
    assert list(primvars.GetPrimvar("featherId").Get()) == [each.id for each in entries]
    # seen from dorsal with the tip ahead, the left barbs are on the left
    shaft = np.array(UsdGeom.BasisCurves(curves).GetPointsAttr().Get()).reshape(-1, KEPT[0], 3)
    left = np.array(primvars.GetPrimvar("P_barbl").Get()).reshape(-1, *KEPT, 3)
    ups = np.array(primvars.GetPrimvar("up").Get())
    ahead = shaft[:, -1] - shaft[:, 0]
    apart = (left[:, :, -1] - shaft).sum(axis=1)
    assert (np.einsum("fc,fc->f", np.cross(ups, ahead), apart) > 0.0).all()


@pytest.mark.parametrize(
    ("form", "velocities", "has"),
    [("condensed", None, False), ("both", "none", False), ("condensed", "full", True)],
)
def test_velocities_are_left_out_of_condensed_feathers(entries, tmp_path, form, velocities, has):
    path = write(tmp_path / "still.usdc", entries, form=form, velocities=velocities)
    stage = Usd.Stage.Open(str(path))
    found = [each.GetAttribute("velocities") for each in prims(stage, UsdGeom.Curves)]
    assert {each.Get(2.0) is not None for each in found} == {has}
    if has:
        for each in found:
            counts = UsdGeom.BasisCurves(each.GetPrim()).GetCurveVertexCountsAttr().Get()
            assert len(each.Get(2.0)) == sum(counts)
    assert check_usd(path) == []


@pytest.mark.parametrize("group", ["feather", "all"])
def test_accelerations_bring_velocities_along(entries, tmp_path, group):
    asked = {"form": "condensed", "group": group, "accelerations": True}
    path = write(tmp_path / "shaken.usdc", entries, **asked)
    stage = Usd.Stage.Open(str(path))
    for each in prims(stage, UsdGeom.Curves):
        schema = UsdGeom.BasisCurves(each)
        rates = schema.GetVelocitiesAttr(), schema.GetAccelerationsAttr()
        counts = [len(attribute.Get(2.0)) for attribute in rates]
        assert counts == [len(schema.GetPointsAttr().Get(2.0))] * 2
    assert check_usd(path) == []


def lifted(entry, seed: int) -> RowPoints:
    """A feather that is bent, and whose nodes stand up by up to 0.6 % of its length here and there,
    as layers lift them."""
    noise, pose = np.random.default_rng(seed), bent(entry.rest_points, 2)
    up = np.abs(noise.normal(0.0, 2e-3, pose.nodes.shape[:2])).clip(0.0, 6e-3)
    up *= noise.random(up.shape) < 0.2
    up[:, 0] = 0.0
    length = entry.feather.station[-1]
    return pose._replace(nodes=pose.nodes + length * up[..., None] * pose.directors[:, 1:2])


@pytest.mark.parametrize("group", ["feather", "all"])
def test_a_sample_of_a_condensed_feather_is_small_and_close(entries, tmp_path, group):
    """25,000 feathers and 96 frames in less than 1 GB are 416 bytes each, constants included."""
    poses = [[lifted(each, 100 * k + j) for k, each in enumerate(entries)] for j in range(9)]
    sizes, path = [], tmp_path / "lifted.usdc"
    for last in (2, 8):
        options = WriteOptions(form="condensed", group=group, overwrite=True)
        with CacheWriter(path, entries, (0, last), 24.0, options) as writer:
            for number in range(last + 1):
                still = [both(np.zeros_like, each) for each in poses[number]]
                frame = feathers.frame_of(number, number / 24, poses[number], still)
                writer.write(frame)
        sizes.append(path.stat().st_size)
    if group == "all":
        assert (sizes[1] - sizes[0]) / (6 * len(entries)) < 395
    found = expand(path)
    for number in (0, 7):
        points = found.points(number)
        for own, entry, pose in zip(found.feathers, entries, poses[number], strict=True):
            off = points[own.points] - entry.feather.surface.points(pose)
            assert np.linalg.norm(off, axis=1).max() < 0.7e-3 * entry.feather.station[-1]


def test_in_slow_motion_they_pass_through_what_was_written(entries, tmp_path):
    path = tmp_path / "lifted.usdc"
    with CacheWriter(path, entries, (1, 3), 24.0, WriteOptions(form="condensed")) as writer:
        for number in (1, 2, 3):
            poses = [lifted(each, number) for each in entries]
            still = [both(np.zeros_like, each) for each in poses]
            writer.write(feathers.frame_of(number, (number - 1) / 24, poses, still))
    slow, found = expand(featherfx.retime(path, tmp_path / "slow.usdc", speed=0.5)), expand(path)
    for number in (1, 2, 3):
        np.testing.assert_allclose(slow.points(2 * number - 1), found.points(number), atol=1e-6)
    # lifts of either sample are half gone, to half a step
    between, mean = slow.points(2.0), 0.5 * (found.points(1.0) + found.points(2.0))
    length = min(each.feather.station[-1] for each in entries)
    assert np.linalg.norm(between - mean, axis=1).max() < 1.5e-3 * length


@pytest.mark.parametrize("grid", [None, [(11, 4)], [(3, 1)] * 4, [(11, 10**6)] * 4, [(-11, 4)] * 4])
def test_grids_that_do_not_fit_are_refused(baked, tmp_path, grid):
    stage = Usd.Stage.Open(str(baked["condensed", "all"]))
    stage = Usd.Stage.Open(stage.Flatten())
    (curves,) = prims(stage, UsdGeom.BasisCurves)
    assert len(curves.GetAttribute("featherDetail:grid").Get()) == 4
    if grid is None:
        curves.GetAttribute("featherDetail").Clear()
    else:
        curves.GetAttribute("featherDetail:grid").Set(grid)
    with pytest.raises(InputError, match="featherDetail"):
        expand(stage).points(1.0)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Wing feathers as they are simulated, and as a bake draws them with finer
    meshes and barbs: entries, both."""
    groom = featherfx.read_groom(SAMPLES / "swan_wing/groom.toml")
    chosen = replace(groom, feathers=groom.feathers[::6])
    assert all(each.size != 1.0 for each in chosen.feathers)
    quality = replace(featherfx.read_quality("draft"), rows=GRID[0], columns=GRID[1])
    names = [each.id for each in chosen.feathers]
    options = DrawnOptions(render_rows=47, render_columns=9, barbs=30)
    coarse = entries_of(chosen, build_feathers(chosen.feathers, *GRID), static=False)
    return coarse, drawn_entries(chosen, quality, options, names, None)


def test_other_densities_are_what_a_bake_of_them_writes(drawn, tmp_path):
    coarse, fine = drawn
    poses = [bent(each.rest_points, 2) for each in coarse]
    still = [both(np.zeros_like, each) for each in poses]
    frame, caches = feathers.frame_of(1, 0.0, poses, still), {}
    for form, given in (("condensed", coarse), ("mesh", fine)):
        caches[form] = tmp_path / f"{form}.usdc"
        options = WriteOptions(form=form, group="all", meters_per_unit=0.01, up_axis="Y")
        with CacheWriter(caches[form], given, (1, 1), 24.0, options) as writer:
            writer.write(frame)
    made, meshes = expand(caches["condensed"], rows=47, columns=9, barbs=30), Cache(caches["mesh"])
    points, barbs = made.points(1.0), made.barbs(1.0)
    stage = Usd.Stage.Open(str(caches["mesh"]))
    (curves,) = (
        each for each in prims(stage, UsdGeom.BasisCurves) if "barbs" in str(each.GetPath())
    )
    wanted_barbs = np.array(UsdGeom.BasisCurves(curves).GetPointsAttr().Get(1.0)).reshape(-1, 9, 3)
    ends = np.cumsum([0, *(len(each.barbs.side) for each in fine)])
    for k, own in enumerate(made.feathers):
        wanted = meshes.points(k, 1.0)
        length = np.ptp(wanted, axis=0).max()
        assert own.id == meshes.feathers[k].id == fine[k].id
        np.testing.assert_array_equal(own.triangles, meshes.feathers[k].triangles)
        np.testing.assert_allclose(own.st, meshes.feathers[k].st, atol=1e-6)
        assert np.abs(points[own.points] - wanted).max() < 1e-3 * length
        mine = wanted_barbs[ends[k] : ends[k + 1]]
        assert np.abs(barbs[own.barbs] - mine).max() < 1e-3 * length
        np.testing.assert_array_equal(own.barb_side, fine[k].barbs.side)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        "null",
        '{"mirrored":true,"name":3}',
        '{"mirrored":false,"size":1}',
        "[" * 9000,
    ],
)
def test_shapes_that_are_none_are_refused(baked, tmp_path, text):
    stage = Usd.Stage.Open(str(baked["condensed", "all"]))
    stage = Usd.Stage.Open(stage.Flatten())
    (curves,) = prims(stage, UsdGeom.BasisCurves)
    UsdGeom.PrimvarsAPI(curves).GetPrimvar("featherShape").Set([text])
    with pytest.raises(InputError, match="featherShape"):
        expand(stage)


@pytest.mark.parametrize(("form", "within"), [("both", 2e-6), ("condensed", 3e-5)])
def test_a_rigid_motion_is_kept_at_every_density(entries, tmp_path, form, within):
    """To single precision, or, where frames of half precision lead, to 0.01 % of the length."""
    path = tmp_path / "rigid.usdc"
    turn, way = about_x(40.0), np.array([0.3, -0.2, 0.1])
    with CacheWriter(path, entries, (1, 2), 24.0, WriteOptions(form=form)) as writer:
        for number, matrix, shift in ((1, np.eye(3), 0 * way), (2, turn, way)):
            points = [
                both(lambda part, m=matrix: part @ m.T, each.rest_points).shifted(shift)
                for each in entries
            ]
            still = [both(np.zeros_like, each) for each in points]
            writer.write(feathers.frame_of(number, (number - 1) / 24, points, still))
    for density in ({}, {"rows": 23, "columns": 7, "barbs": 9}):
        fine = expand(path, **density)
        for made in (fine.points, lambda code, own=fine: own.barbs(code).reshape(-1, 3)):
            np.testing.assert_allclose(made(2.0), made(1.0) @ turn.T + way, atol=within)


def test_densities_out_of_range_and_other_files_are_refused(baked, tmp_path):
    with pytest.raises(InputError, match=r"rows: 2 is not allowed. Give 3 to") as caught:
        expand(baked["condensed", "all"], rows=2, barbs=0)
    assert len(caught.value.problems) == 2
    with pytest.raises(InputError, match="holds no condensed feathers"):
        expand(baked["mesh", "feather"])
    stage = Usd.Stage.Open(str(baked["condensed", "all"]))
    (curves,) = prims(stage, UsdGeom.BasisCurves)
    UsdGeom.PrimvarsAPI(curves).GetPrimvar("P_barbr").Set([(0, 0, 0)], 2.0)
    with pytest.raises(InputError, match=r"P_barbr: .*too many or few"):
        expand(stage).points(2.0)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"form": "curves"}, "curves needs barbs"),
        ({"form": "condensed", "barbs": 9}, "condensed has no barbs"),
        ({"form": "condensed", "diagnostics": ("strain",)}, "condensed has no barbs and diagnost"),
        ({"velocities": "none", "accelerations": True}, "none leaves no accelerations"),
    ],
)
def test_forms_that_do_not_fit_are_refused_before_any_work(tmp_path, options, told):
    with pytest.raises(InputError, match=told):
        featherfx.bake(SAMPLES / "breeze/shot.toml", tmp_path / "no.usdc", **options)
    assert list(tmp_path.iterdir()) == []


def test_vanes_that_may_split_have_no_condensed_form(tmp_path):
    with pytest.raises(InputError, match="may split, which condensed feathers have no place for"):
        featherfx.bake(SAMPLES / "torn_feather/shot.toml", tmp_path / "no.usdc", form="condensed")
