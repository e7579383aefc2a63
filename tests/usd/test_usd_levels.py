"""Versions of a cache with fewer points: what they hold, what is drawn, and who chooses."""

from __future__ import annotations

import feathers
import numpy as np
import pytest
from commands import invoke
from pxr import Gf, Usd, UsdGeom

from featherfx.errors import InputError
from featherfx.usd.check.check import check_usd
from featherfx.usd.convert import levels
from featherfx.usd.convert.levels import export_levels, has_usd_lod
from featherfx.usd.read.cache import Cache
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

needs_lod = pytest.mark.skipif(not has_usd_lod(), reason="this USD has no UsdLod")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    path = tmp_path_factory.mktemp("levels") / "wing.usdc"
    options = WriteOptions(group="kind")
    with CacheWriter(path, feathers.entries(), (1, 3), 24.0, options) as writer:
        for number in (1, 2, 3):
            writer.write(feathers.frame(number))
    return path


def exported(cache, name="lod.usda"):
    target = cache.with_name(name)
    return target, export_levels(cache, target, overwrite=True)


def of_points(cache, code, name):
    """By place, what a cache has of the points that stand there."""
    found = {}
    for index in range(len(cache.feathers)):
        pose = cache.pose(index, code)
        values = getattr(pose, name)
        values = np.zeros(pose.points.shape) if values is None else values  # it stands still
        for at, value in zip(pose.points.tolist(), values, strict=True):
            found.setdefault(tuple(at), []).append(value)
    return found


def test_the_finest_is_drawn_and_the_others_hold_some_of_its_points(cache):
    target, told = exported(cache)
    found, whole = Cache(target), Cache(cache)
    assert [each.id for each in found.feathers] == [each.id for each in whole.feathers]
    assert found.frames == whole.frames
    every = range(len(whole.feathers))
    for code in (1.0, 2.0):
        for one, other in zip(
            found.points_of(every, code), whole.points_of(every, code), strict=True
        ):
            np.testing.assert_array_equal(one, other)
    names, triangles = zip(*told, strict=True)
    assert names[0] == "full"
    assert list(triangles) == sorted(triangles, reverse=True)
    assert len(set(triangles)) == len(triangles) > 2
    stage = Usd.Stage.Open(str(target))
    variants = stage.GetDefaultPrim().GetVariantSet(levels.LEVEL_SET)
    assert sorted(variants.GetVariantNames()) == sorted(names)
    for name in names[1:]:
        mesh = UsdGeom.Mesh.Get(stage, f"/wing/levels/{name}/feathers")
        assert len(mesh.GetFaceVertexCountsAttr().Get()) == triangles[names.index(name)]
        ids = [*UsdGeom.PrimvarsAPI(mesh).GetPrimvar("featherId").Get()]
        assert ids == [each.id for each in whole.feathers]
        ranges = mesh.GetPrim().GetAttribute("featherRange:points").Get()
        for code in (1.0, 3.0):
            points = np.asarray(mesh.GetPointsAttr().Get(code))
            for (first, number), wanted in zip(ranges, whole.points_of(every, code), strict=True):
                own = {tuple(each) for each in points[first : first + number].tolist()}
                assert own <= {tuple(each) for each in wanted.astype(np.float32).tolist()}
            for what, attribute in (
                ("velocities", mesh.GetVelocitiesAttr()),
                ("normals", mesh.GetNormalsAttr()),
            ):
                told_of = of_points(whole, code, what)
                for at, value in zip(points.tolist(), attribute.Get(code), strict=True):
                    assert any(np.allclose(value, one, atol=1e-5) for one in told_of[tuple(at)]), (
                        name,
                        at,
                    )
        assert mesh.ComputeVisibility() == UsdGeom.Tokens.invisible
        variants.SetVariantSelection(name)
        assert mesh.ComputeVisibility() == UsdGeom.Tokens.inherited
        full = UsdGeom.Imageable(stage.GetPrimAtPath("/wing/levels/full"))
        assert full.ComputeVisibility() == UsdGeom.Tokens.invisible
        variants.SetVariantSelection("full")
    assert check_usd(target) == []


@needs_lod
def test_a_renderer_chooses_by_size(cache):
    from pxr import UsdLod

    target, told = exported(cache)
    stage = Usd.Stage.Open(str(target))
    root = UsdLod.RootAPI(stage.GetPrimAtPath("/wing/levels"))
    assert [each.GetName() for each in root.GetPrim().GetChildren()] == [name for name, _ in told]
    (target,) = root.GetLodHeuristicsRel().GetTargets()
    heuristic = UsdLod.ScreenSizeHeuristic.Get(stage, target)
    low, high = map(np.array, heuristic.GetExtentAttr().Get())
    whole = Cache(cache)
    points = [np.concatenate(whole.points_of(range(len(whole.feathers)), k)) for k in (1.0, 2.0)]
    assert (np.concatenate(points) >= low - 1e-6).all()
    assert (np.concatenate(points) <= high + 1e-6).all()
    query, chosen = heuristic.CreateScreenSizeHeuristicQuery(Usd.TimeCode(1.0)), []
    for away in (1.0, 3.0, 10.0, 100.0):
        camera = Gf.Frustum()
        camera.SetPerspective(40.0, 16 / 9, 0.01, 1e4)
        at = Gf.Vec3d(*(0.5 * (low + high)).tolist())
        size = float(np.linalg.norm(high - low))
        camera.SetPosition(at + Gf.Vec3d(0, 0, away * size))
        shown = query.ComputeScreenSize(camera, Gf.Matrix4d(1.0))
        chosen.append(query.ComputeLOD(shown))
    assert chosen == sorted(chosen)
    assert (chosen[0], chosen[-1]) == (0.0, len(told) - 1.0)


def test_a_usd_without_levels_gets_variants_alone(cache, monkeypatch):
    monkeypatch.setattr(levels, "has_usd_lod", lambda: False)
    target, told = exported(cache, "plain.usda")
    text = target.read_text()
    assert "LOD" not in text
    stage = Usd.Stage.Open(str(target))
    names = stage.GetDefaultPrim().GetVariantSet(levels.LEVEL_SET).GetVariantNames()
    assert sorted(names) == sorted(name for name, _ in told)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--lod", "0.1,0.2"], "0.1, 0.2 is not allowed. Give falling numbers above 0"),
        (["--lod", "0"], "0 is not allowed. Give falling numbers above 0"),
        (["--lod", "much"], "'much' is no list of numbers"),
        (["--lod", "0.1", "--rigid", "1"], "--lod goes with a USD file"),
    ],
)
def test_bad_thresholds_are_told(cache, tmp_path, words, told):
    result = invoke("export", cache, "-o", tmp_path / "o.usdc", *words)
    assert result.exit_code in (1, 2)
    assert told in result.stderr
    assert not [*tmp_path.iterdir()]


def test_the_cache_itself_is_no_output(cache):
    before = cache.read_bytes()
    with pytest.raises(InputError):
        export_levels(cache, cache, overwrite=True)
    assert cache.read_bytes() == before
