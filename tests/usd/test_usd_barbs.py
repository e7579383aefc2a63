"""Barbs as curves beside meshes of another grid, in caches where not every feather has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feathers import frame_of, usd_faults
from places import SAMPLES
from pxr import Usd, UsdGeom, UsdUtils
from scipy.spatial.transform import Rotation

import featherfx
import featherfx.baking.pipeline as pipeline
from featherfx.algebra.vectors import face_products
from featherfx.feather.barb_looks import barb_curves, render_feather
from featherfx.feather.build import build_feather
from featherfx.feather.types import RowPoints, both
from featherfx.shot.frames import place
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write import prims
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

GRID, FINE, BARBS = (11, 3), (30, 5), 40
NAMES = ("bare", "moving", "still", "fixed")
EVERY = [0.0, 0.3, 0.6]


def pose(points: RowPoints, index: int, angle: float) -> RowPoints:
    turn = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    return place(points, np.array([0.0, 0.2 * index, 0.0]), turn)


@pytest.fixture(scope="module", params=["flat", "payload", "clips"])
def cache(request, tmp_path_factory: pytest.TempPathFactory):
    """Three frames of four feathers: the first has no barbs, the last two do not move."""
    kind = featherfx.read_groom(SAMPLES / "feather_pull/groom.toml").feathers[0].kind
    coarse = build_feather(kind, *GRID)
    fine, points_map = render_feather(kind, GRID, FINE, False)
    barbs = barb_curves(kind, GRID, BARBS, False)
    entries = [
        FeatherEntry(
            name, "k", "r", fine, pose(fine.rest, k, 0.0), name == "fixed", None, "", points_map,
            None if name == "bare" else shifted(barbs, k),
        )
        for k, name in enumerate(NAMES)
    ]  # fmt: skip
    path = tmp_path_factory.mktemp("barbs") / "cache.usda"
    options = WriteOptions(layout=request.param, chunk=2, up_axis="Y", meters_per_unit=0.01)
    with CacheWriter(path, entries, (1, 3), 24.0, options) as writer:
        for number, angle in enumerate(EVERY, start=1):
            given = [
                pose(coarse.rest, k, angle if NAMES[k] in ("bare", "moving") else 0.0)
                for k in range(len(NAMES))
            ]
            rates = [both(np.zeros_like, each) for each in given]
            writer.write(frame_of(number, (number - 1) / 24, given, rates))
    return path, kind, barbs


def shifted(barbs, index):
    return replace(barbs, points=barbs.points + np.array([0.0, 0.2 * index, 0.0]))


def test_turned_feathers_keep_their_barbs_in_stage_units(cache):
    path, _, barbs = cache
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves.Get(stage, "/cache/barbs/moving_barbs")
    for number, angle in enumerate(EVERY, start=1):
        turn = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
        x, y, z = (barbs.points.reshape(-1, 3) @ turn.T + [0.0, 0.2, 0.0]).T
        wanted = 100.0 * np.stack([x, z, -y], axis=-1)
        np.testing.assert_allclose(curves.GetPointsAttr().Get(number), wanted, atol=1e-4)
    assert len(curves.GetWidthsAttr().Get()) == barbs.widths.size
    np.testing.assert_allclose(curves.GetWidthsAttr().Get(), 100 * barbs.widths.ravel(), rtol=1e-6)


def test_barbs_take_the_texture_of_their_vane(cache):
    """From the rachis (u = 0.5) to the edge of their side; v grows from barb to barb."""
    path, _, barbs = cache
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath("/cache/barbs/moving_barbs")
    st = np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("st").Get()).reshape(*barbs.widths.shape, 2)
    np.testing.assert_allclose(st[:, 0, 0], 0.5)
    np.testing.assert_allclose(st[:, -1, 0], np.where(barbs.side == 0, 1.0, 0.0))
    for side in (0, 1):
        along = st[barbs.side == side, :, 1]
        assert (np.diff(along[:, 0]) > 0.0).all()
        assert (along == along[:, :1]).all()
        assert 0.0 < along.min() < along.max() <= 1.0


def test_barbs_are_smooth_curves_that_taper_and_cover_a_part_of_their_vane(cache):
    path, kind, barbs = cache
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves.Get(stage, "/cache/barbs/moving_barbs")
    form = curves.GetTypeAttr().Get(), curves.GetBasisAttr().Get(), curves.GetWrapAttr().Get()
    assert form == ("cubic", "catmullRom", "pinned")
    own = barbs.ramus * barbs.widths
    assert (np.diff(own, axis=1) < 0.0).mean() > 0.98
    lengths = np.linalg.norm(np.diff(barbs.points, axis=1), axis=2)
    covered = (lengths * 0.5 * (own[:, 1:] + own[:, :-1])).sum()
    assert covered / vane_corners(kind)[1].sum() == pytest.approx(0.14, rel=0.05)  # Jouve 2024


def vane_corners(kind):
    """Corners (T, 3, 3) of the vanes' triangles, and areas (T,)."""
    feather = build_feather(kind, *FINE)
    surface = feather.surface
    corners = surface.points(feather.rest)[surface.triangles[surface.part < 2]]
    return corners, 0.5 * np.linalg.norm(face_products(corners), axis=1)


def test_barbs_at_their_real_count_are_as_opaque_as_the_mesh():
    kind = featherfx.read_groom(SAMPLES / "feather_pull/groom.toml").feathers[0].kind
    barbs, (corners, areas) = barb_curves(kind, GRID, kind.barb_count, False), vane_corners(kind)
    random = np.random.default_rng(1)
    face = random.choice(len(areas), 1500, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], len(face))
    places = np.einsum("nk,nkc->nc", weights, corners[face])
    starts, steps = (
        barbs.points[:, :-1].reshape(-1, 3),
        np.diff(barbs.points, axis=1).reshape(-1, 3),
    )
    first, last = barbs.widths[:, :-1].ravel(), barbs.widths[:, 1:].ravel()
    is_covered = []
    for point in places:
        along = np.clip(((point - starts) * steps).sum(1) / (steps * steps).sum(1), 0.0, 1.0)
        away = np.linalg.norm(starts + along[:, None] * steps - point, axis=1)
        is_covered.append((away <= 0.5 * (first + along * (last - first))).any())
    assert np.mean(is_covered) > 0.95


def test_each_barb_has_its_number_place_root_and_hooks(cache):
    path, _, barbs = cache
    stage = Usd.Stage.Open(str(path))

    def read(name, feather="moving"):
        prim = stage.GetPrimAtPath(f"/cache/barbs/{feather}_barbs")
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
        return np.array(primvar.Get()), primvar.GetInterpolation()

    ids = [read("barbId", name)[0] for name in NAMES[1:]]
    assert len(np.unique(ids)) == 3 * len(barbs.side)
    again = prims.barb_ids("moving", barbs)
    np.testing.assert_array_equal(ids[0], again)
    index, how = read("barbIndex")
    assert how == "uniform"
    for side in (0, 1):
        np.testing.assert_array_equal(
            index[barbs.side == side], np.arange((barbs.side == side).sum())
        )
    np.testing.assert_allclose(read("rootUv")[0], barbs.st[:, 0], rtol=1e-6)
    hooked, how = read("hooked")
    assert how == "vertex"
    assert len(hooked) == barbs.widths.size
    assert ((hooked >= 0.0) & (hooked <= 1.0)).all()


@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_of_barbs_are_dorsal_and_turn_with_them(mirrored):
    kind = featherfx.read_groom(SAMPLES / "feather_pull/groom.toml").feathers[0].kind
    barbs, feather = barb_curves(kind, GRID, BARBS, mirrored), build_feather(kind, *GRID, mirrored)
    points = barbs.points.reshape(-1, 3)
    normals = barbs.normals(points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (normals @ feather.rest.directors[:, 1].mean(axis=0) > 0.5).mean() > 0.98
    along = np.gradient(barbs.points, axis=1).reshape(-1, 3)
    assert np.abs((normals * along).sum(axis=1)).max() < 1e-9
    turn = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    np.testing.assert_allclose(barbs.normals(points @ turn.T), normals @ turn.T, atol=1e-9)


def test_only_what_moves_has_samples(cache):
    stage = Usd.Stage.Open(str(cache[0]))
    assert not stage.GetPrimAtPath("/cache/barbs/bare_barbs")
    for name in NAMES[1:]:
        for prim in (f"barbs/{name}_barbs", f"feathers/{name}", f"rachises/{name}_rachis"):
            shape = UsdGeom.PointBased.Get(stage, f"/cache/{prim}")
            count = len(shape.GetPointsAttr().GetTimeSamples())
            assert count == (3 if name == "moving" else 0), prim
            assert shape.GetPointsAttr().Get(2) is not None
    assert not featherfx.check(cache[0])


def test_the_extent_of_the_root_covers_the_barbs(cache):
    stage = Usd.Stage.Open(str(cache[0]))
    low, high = np.array(stage.GetDefaultPrim().GetAttribute("extentsHint").Get())[:2]
    for prim in stage.GetPrimAtPath("/cache/barbs").GetChildren():
        for code in (1, 2, 3):
            corners = np.array(UsdGeom.BasisCurves(prim).GetExtentAttr().Get(code))
            assert np.all(corners[0] >= low - 1e-5)
            assert np.all(corners[1] <= high + 1e-5)


@pytest.mark.parametrize("variant", ["vane", "barbs", "rachis"])
def test_usd_finds_no_fault_in_any_representation(cache, variant):
    """USD's validators, or the checker that older USDs have in their place."""
    path = cache[0]
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    stage.GetDefaultPrim().GetVariantSet("representation").SetVariantSelection(variant)
    if hasattr(UsdUtils, "ComplianceChecker"):
        checker = UsdUtils.ComplianceChecker(skipARKitRootLayerCheck=True)
        checker.CheckCompliance(str(path))
        assert [*checker.GetErrors(), *checker.GetFailedChecks()] == []
    assert usd_faults(stage) == []


def test_extents_are_those_that_usd_computes_to_the_last_bit(cache):
    """Of meshes, rachises and barbs, in every frame and at rest; strict validators compare them."""
    stage, compared = Usd.Stage.Open(str(cache[0])), 0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.PointBased):
            continue
        drawn = UsdGeom.PointBased(prim)
        for code in (Usd.TimeCode.Default(), 1, 2, 3):
            points, written = drawn.GetPointsAttr().Get(code), drawn.GetExtentAttr().Get(code)
            if prim.IsA(UsdGeom.Curves):
                widths = UsdGeom.Curves(prim).GetWidthsAttr().Get()
                wanted = UsdGeom.Curves.ComputeExtent(points, widths)
            else:
                wanted = UsdGeom.PointBased.ComputeExtent(points)
            assert written == wanted, f"{prim.GetPath()} at {code}"
            compared += 1
    assert compared == 4 * (2 * len(NAMES) + len(NAMES) - 1)


def test_alembic_has_shafts_and_barbs_as_a_groom(cache, tmp_path):
    abc, geometry = pytest.importorskip("alembic3d.Abc"), pytest.importorskip("alembic3d.AbcGeom")
    path, _, barbs = cache
    out = tmp_path / "groom.abc"
    assert pipeline.export(path, out) == [out]
    stage, top = Usd.Stage.Open(str(path)), abc.IArchive(str(out)).getTop()
    drawn = [
        UsdGeom.BasisCurves(each) for each in stage.Traverse() if each.IsA(UsdGeom.BasisCurves)
    ]
    assert top.getNumChildren() == len(NAMES) + len(drawn)
    numbers = []
    for curves in drawn:
        name = curves.GetPrim().GetName()
        schema = geometry.ICurves(top, name).getSchema()
        told, own = schema.getUserProperties(), schema.getArbGeomParams()
        version = [
            abc.IInt16Property(told, f"groom_version_{k}").getValue() for k in ("major", "minor")
        ]
        assert version == [1, 5]

        def values(kind, attribute, own=own):
            found = getattr(geometry, f"I{kind}GeomParam")(own, attribute)
            return found.getScope(), np.array(
                [
                    tuple(np.atleast_1d(x)) if np.isscalar(x) else tuple(x)
                    for x in found.getExpandedValue().getVals()
                ]
            )

        is_barb = name.endswith("_barbs")
        assert values("Int32", "groom_group_id")[1].ravel().tolist() == [int(is_barb)]
        numbers += values("Int32", "groom_id")[1].ravel().tolist()
        scope, widths = values("Float", "groom_width")
        assert scope == geometry.GeometryScope.kVertexScope
        np.testing.assert_array_equal(widths.ravel(), curves.GetWidthsAttr().Get())
        for frame in (1, 2, 3):
            sample = schema.getValue(abc.ISampleSelector(frame / 24.0))
            np.testing.assert_array_equal(
                list(sample.getCurvesNumVertices()), curves.GetCurveVertexCountsAttr().Get()
            )
            found = np.array([tuple(each) for each in sample.getPositions()])
            np.testing.assert_array_equal(found, curves.GetPointsAttr().Get(frame))
            assert sample.getType() == geometry.CurveType.kLinear
        if is_barb:
            st = np.array(UsdGeom.PrimvarsAPI(curves).GetPrimvar("st").Get()).reshape(
                len(barbs.side), -1, 2
            )
            scope, roots = values("V2f", "groom_root_uv")
            assert scope == geometry.GeometryScope.kUniformScope
            np.testing.assert_array_equal(roots, st[:, 0])
    assert numbers == list(range(len(numbers)))
    assert len(numbers) == len(NAMES) + 3 * len(barbs.side)
