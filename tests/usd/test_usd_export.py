"""Caches in other forms hold the same poses."""

from __future__ import annotations

import errno
import json
import struct
from dataclasses import replace
from pathlib import Path

import feathers
import numpy as np
import pytest
import trimesh
from commands import invoke
from places import SAMPLES
from pxr import Usd, UsdGeom

import featherfx
from featherfx.baking import pipeline
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.usd.read.cache import Cache
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two wings at rest, some feathers mirrored."""
    path = tmp_path_factory.mktemp("wing") / "wing.usdc"
    featherfx.export_groom(SAMPLES / "swan_wing/groom.toml", path, quality="preview")
    return path


def test_a_cache_that_ends_before_it_begins_is_refused(tmp_path, caches):
    path = tmp_path / "damaged.usdc"
    pipeline.export(caches["usdc"], path)
    stage = Usd.Stage.Open(str(path))
    stage.SetEndTimeCode(-5)
    stage.Save()
    result = invoke("export", path, "-o", tmp_path / "out.ply")
    assert result.exit_code == 1
    told = "endTimeCode: is -5, no whole frame lies between it and startTimeCode, 1."
    assert result.stderr.splitlines()[-1].endswith(told)


@pytest.mark.parametrize("kind", ["clips", "payload", "usdc"])
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_a_flattened_cache_stands_alone(tmp_path, caches, kind, suffix):
    path = tmp_path / f"out{suffix}"
    assert pipeline.export(caches[kind], path) == [path]
    stage, source = Usd.Stage.Open(str(path)), Cache(caches[kind])
    assert [layer for layer in stage.GetUsedLayers() if not layer.anonymous] == [
        stage.GetRootLayer()
    ]
    assert not stage.GetDefaultPrim().HasAuthoredMetadata("clips")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 5.0)
    assert pipeline.check(path) == []
    flat = Cache(path)
    for index in range(4):
        for code in (None, 1.0, 2.25, 4.5, 5.0):
            one, other = flat.pose(index, code), source.pose(index, code)
            np.testing.assert_array_equal(one.points, other.points)
            np.testing.assert_array_equal(one.barb_direction, other.barb_direction)


def test_condensed_feathers_carry_the_barbs(tmp_path, caches):
    path = tmp_path / "condensed.usda"
    pipeline.export(caches["clips"], path, condensed=True)
    assert pipeline.check(path) == []
    with pytest.raises(InputError, match="without the shapes of `bake --as condensed`"):
        Cache(path)
    stage = Usd.Stage.Open(str(path))
    curve = UsdGeom.BasisCurves.Get(stage, "/condensed/primary_1")
    for code in (1, 4):
        material = feathers.frame(code).poses[0].points.nodes
        np.testing.assert_allclose(curve.GetPointsAttr().Get(code), material[:, 0], atol=1e-7)
        for name, first in (("P_barbl", 1), ("P_barbr", 1 + feathers.COLUMNS)):
            primvar = UsdGeom.PrimvarsAPI(curve).GetPrimvar(name)
            assert primvar.GetElementSize() == feathers.COLUMNS
            barbs = np.array(primvar.Get(code)).reshape(feathers.ROWS, feathers.COLUMNS, 3)
            nodes = material[:, first : first + feathers.COLUMNS]
            np.testing.assert_allclose(barbs, nodes, atol=1e-7)


def test_condensed_feathers_keep_subframes(tmp_path):
    path = tmp_path / "half.usdc"
    with CacheWriter(
        path, feathers.entries()[:1], (1, 2), 24.0, WriteOptions(subframes=2)
    ) as writer:
        for code in (1, 1.5, 2):
            frame = feathers.frame(code)
            writer.write(replace(frame, poses=frame.poses[:1]))
    pipeline.export(path, tmp_path / "condensed.usda", condensed=True)
    stage = Usd.Stage.Open(str(tmp_path / "condensed.usda"))
    points = UsdGeom.BasisCurves.Get(stage, "/condensed/primary_1").GetPointsAttr()
    assert points.GetTimeSamples() == [1.0, 1.5, 2.0]
    wanted = feathers.frame(1.5).rows[0][:, 0]
    np.testing.assert_allclose(points.Get(1.5), wanted, atol=1e-7)


def test_condensed_feathers_are_a_groom_again(tmp_path, wing):
    path = tmp_path / "condensed.usdc"
    pipeline.export(wing, path, condensed=True)
    before = featherfx.read_groom(SAMPLES / "swan_wing/groom.toml").feathers
    after = {each.id: each for each in featherfx.read_groom(path).feathers}
    assert len(after) == len(before) == 20
    for old in before[::3]:
        new = after[old.id]
        np.testing.assert_allclose(new.position, old.position, atol=1e-6)
        assert new.kind.length == pytest.approx(old.kind.length, rel=5e-3)
        assert new.kind.calamus == pytest.approx(old.kind.calamus, abs=0.12)
        one, other = (
            build_feather(each.kind, 21, 5, each.mirrored).barb_length for each in (old, new)
        )
        if old.mirrored:  # a USD groom is read as a right wing, whose left vanes lead
            other = other[::-1]
        assert np.quantile(np.abs(one - other), 0.85) < 0.05 * one.max()
        assert one[0].max() / one[1].max() == pytest.approx(
            other[0].max() / other[1].max(), rel=0.1
        )


@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_mesh_sequences(tmp_path, caches, suffix):
    files = pipeline.export(caches["usdc"], tmp_path / f"look{suffix}", frames=(2, 3))
    assert [file.name for file in files] == [f"look.000{k}{suffix}" for k in (2, 3)]
    cache = Cache(caches["usdc"])
    for code, file in ((2.0, files[0]), (3.0, files[1])):
        scene = trimesh.load_scene(file, process=False)
        found = scene.to_geometry() if suffix == ".glb" else trimesh.load_mesh(file)
        points = np.concatenate([cache.pose(k, code).points for k in range(4)])
        if suffix == ".glb":
            points = points[:, [0, 2, 1]] * (1, 1, -1)
            assert set(scene.geometry) == {f.path.rpartition("/")[2] for f in cache.feathers}
        np.testing.assert_allclose(
            found.bounds, [points.min(axis=0), points.max(axis=0)], atol=1e-6
        )
        assert len(found.faces) == 4 * len(cache.feathers[0].triangles)


def test_a_sequence_appears_whole_or_not_at_all(tmp_path, caches, monkeypatch):
    """The disk is full at the third of five files; those of an earlier export stay."""
    (tmp_path / "look.0002.obj").write_text("earlier")
    forced = []

    def flush(handle):
        forced.append(handle)
        if len(forced) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", flush)
    with pytest.raises(InputError, match=r"look\.0003\.obj: not written .No space left"):
        pipeline.export(caches["usdc"], tmp_path / "look.obj", overwrite=True)
    (left,) = tmp_path.iterdir()
    assert left.read_text() == "earlier"


def glb(path: Path):
    """The JSON of a .glb file, and a function from an accessor's number to its values."""
    content = path.read_bytes()
    magic, version, total, size, kind = struct.unpack_from("<4sIII4s", content)
    assert (magic, version, total, kind) == (b"glTF", 2, len(content), b"JSON")
    told = json.loads(content[20 : 20 + size])
    binary, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert (kind, 28 + size + binary) == (b"BIN\0", total)

    def values(number: int):
        accessor = told["accessors"][number]
        view = told["bufferViews"][accessor["bufferView"]]
        kind, wide = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]], accessor["type"]
        count = accessor["count"] * (3 if wide == "VEC3" else 1)
        found = np.frombuffer(content, kind, count, 28 + size + view["byteOffset"])
        found = found.reshape(accessor["count"], -1)
        np.testing.assert_allclose(found.min(axis=0), accessor["min"], rtol=1e-6)
        np.testing.assert_allclose(found.max(axis=0), accessor["max"], rtol=1e-6)
        return found

    return told, values


def test_morph_targets_are_the_frames(tmp_path, caches):
    path, source = tmp_path / "web.glb", Cache(caches["clips"])
    assert pipeline.export(caches["clips"], path, morph=True, frames=(2, 5)) == [path]
    told, values = glb(path)
    (primitive,) = told["meshes"][0]["primitives"]
    sampler = told["animations"][0]["samplers"][0]
    base = values(primitive["attributes"]["POSITION"])
    targets = [values(each["POSITION"]) for each in primitive["targets"]]
    weights = values(sampler["output"]).reshape(4, 3)
    np.testing.assert_allclose(values(sampler["input"])[:, 0], np.arange(4) / 24, atol=1e-6)
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) if source.up_axis == "Z" else np.eye(3)
    for number, shares in enumerate(weights):
        assert sum(shares) == (number > 0)
        found = base + sum(w * each for w, each in zip(shares, targets, strict=True))
        points = np.concatenate(source.points_of(range(4), 2.0 + number))
        wanted = points @ turn.T * source.meters_per_unit
        np.testing.assert_allclose(found, wanted, atol=1e-6)
    corners = values(primitive["indices"]).reshape(-1, 3)
    named = told["nodes"][0]["extras"]["feathers"]
    for each, feather in zip(named, source.feathers, strict=True):
        assert each["id"] == feather.id
        inside = (corners >= each["first"]) & (corners < each["first"] + each["points"])
        own = corners[inside.all(axis=1)] - each["first"]
        np.testing.assert_array_equal(own, feather.triangles)
    assert len(trimesh.load(path).geometry) == 1  # another reader takes it
    with pytest.raises(InputError, match=r"frames: 1 is too few\. Morph targets need 2"):
        pipeline.export(caches["clips"], tmp_path / "one.glb", morph=True, frames=(2, 2))
    result = invoke("export", "x.usdc", "-o", "x.obj", "--morph")
    assert result.exit_code == 2


def test_a_cache_without_time_is_one_file(tmp_path, wing):
    (file,) = pipeline.export(wing, tmp_path / "look.glb")
    assert file.name == "look.glb"
    scene = trimesh.load_scene(file)
    assert len(scene.geometry) == 20
    with pytest.raises(InputError, match="exists already"):
        pipeline.export(wing, tmp_path / "look.glb")


def test_what_cannot_be_exported_is_told(tmp_path, caches, wing):
    with pytest.raises(InputError, match=r"'\.fbx' is not one of \.usd, .*\.abc, \.glb"):
        pipeline.export(wing, tmp_path / "out.fbx")
    with pytest.raises(InputError, match=r"4 to 9 is out of range\. Give frames from 1 to 5"):
        pipeline.export(caches["usda"], tmp_path / "out.obj", frames=(4, 9))
    with pytest.raises(InputError, match="there is no such file"):
        pipeline.export(tmp_path / "none.usdc", tmp_path / "out.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "plain.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/box")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.Save()
    with pytest.raises(InputError, match="has no barb grid"):
        pipeline.export(tmp_path / "plain.usda", tmp_path / "out.usda", condensed=True)
    assert [file.name for file in tmp_path.iterdir()] == ["plain.usda"]
    result = invoke("export", wing, "-o", "a.glb", "--condensed")
    assert result.exit_code == 2
