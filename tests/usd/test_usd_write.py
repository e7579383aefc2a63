"""What is in the files, seen by plain USD in another process."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import feathers
import numpy as np
import pytest
import writing_cost
from pxr import Sdf, Usd, UsdGeom, UsdShade

from featherfx.errors import InputError, SimulationError
from featherfx.feather.types import both
from featherfx.usd.read.cache import Cache
from featherfx.usd.types import FeatherEntry, StageSpace
from featherfx.usd.write import cache_writer, chunks
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.output import unique_prim_names
from featherfx.usd.write.poses import make_posed_feathers
from featherfx.usd.write.unfinished_cache import Parts

KINDS = ("usda", "usdc", "usd", "payload", "clips")
DUMP = """
import json, sys
import numpy as np
from pxr import Usd, UsdGeom
found = []
for path in sys.argv[1:]:
    found.append({})
    stage = Usd.Stage.Open(path)
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointBased):
            found[-1][str(prim.GetPath())] = {
                code: {
                    name: np.asarray(prim.GetAttribute(name).Get(code)).tolist()
                    for name in ("points", "velocities", "extent")
                    if prim.GetAttribute(name).HasAuthoredValue()
                }
                for code in (1.0, 2.0, 2.25, 3.0, 4.0, 5.0)
            }
print(json.dumps(found))
"""


def expected(index: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    surface, pose = feathers.surface(), feathers.frame(number).poses[index]
    return surface.points(pose.points), surface.points(pose.velocities)


@pytest.fixture(scope="module")
def dumped(caches):
    """What another process reads in the caches of every kind."""
    run = [sys.executable, "-c", DUMP, *(str(caches[kind]) for kind in KINDS)]
    done = subprocess.run(run, capture_output=True, check=True)
    return dict(zip(KINDS, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_another_process_reads_every_frame_and_subframes(dumped, kind):
    read = dumped[kind]
    meshes = [path for path in read if "/feathers/" in path]
    curves = [path for path in read if "/rachises/" in path]
    assert len(meshes) == len(curves) == 4
    for index, path in enumerate(meshes):
        for number in (1, 2, 3, 4, 5):
            points, velocities = expected(index, number)
            found = read[path][f"{number}.0"]
            np.testing.assert_allclose(found["points"], points, rtol=1e-6, atol=1e-8)
            if index < 2:
                np.testing.assert_allclose(found["velocities"], velocities, rtol=1e-6, atol=1e-7)
            extent = [points.min(axis=0), points.max(axis=0)]
            np.testing.assert_allclose(found["extent"], extent, rtol=1e-6, atol=1e-8)
            shaft = feathers.frame(number).rows[index][:, 0]
            curve = read[curves[index]][f"{number}.0"]
            np.testing.assert_allclose(curve["points"], shaft, rtol=1e-6, atol=1e-8)
            padded = [shaft.min(axis=0) - feathers.RADIUS, shaft.max(axis=0) + feathers.RADIUS]
            np.testing.assert_allclose(curve["extent"], padded, rtol=1e-6, atol=1e-8)
        between = 0.75 * expected(index, 2)[0] + 0.25 * expected(index, 3)[0]
        np.testing.assert_allclose(read[path]["2.25"]["points"], between, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_stage_metadata_in_every_layer(caches, kind):
    stage = Usd.Stage.Open(str(caches[kind]))
    layers = {layer for layer in stage.GetUsedLayers() if not layer.anonymous}
    layers |= {
        Sdf.Layer.FindOrOpen(str(f)) for f in caches[kind].parent.glob(f"{kind}.clips/*/*.usdc")
    }
    # clips: root, payload, manifest and three chunks
    assert len(layers) == {"payload": 3, "clips": 6}.get(kind, 1)
    for layer in layers:
        assert layer.pseudoRoot.GetInfo("metersPerUnit") == 1.0
        assert layer.pseudoRoot.GetInfo("upAxis") == "Z"
        whole = layer.realPath.endswith("manifest.usdc") or ".clips" not in layer.realPath
        codes = [(1.0, 5.0)] if whole else [(1.0, 2.0), (3.0, 4.0), (5.0, 5.0)]
        assert (layer.startTimeCode, layer.endTimeCode) in codes
        assert layer.timeCodesPerSecond == layer.framesPerSecond == 24.0
        assert layer.defaultPrim == kind
    root = stage.GetDefaultPrim()
    assert Usd.ModelAPI(root).GetKind() == "component"
    assert [p.GetName() for p in stage.GetPseudoRoot().GetChildren()] == [kind]
    assert stage.GetRootLayer().customLayerData == {
        "featherfx": {"shot": "s", "layout": kind if kind in ("payload", "clips") else "flat"}
    }


@pytest.mark.parametrize("kind", KINDS)
def test_samples_only_where_something_moves(caches, kind):
    stage = Usd.Stage.Open(str(caches[kind]))
    moving = ("points", "extent", "velocities", "normals", "primvars:barbDirection")
    sampled = set()
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            if attribute.GetNumTimeSamples():
                assert attribute.GetName() in moving
                assert attribute.GetTimeSamples() == [1.0, 2.0, 3.0, 4.0, 5.0]
                sampled.add(prim.GetName())
    assert sampled == {"primary_1", "primary_1_rachis", "primary_1_2", "primary_1_2_rachis"}
    still = stage.GetPrimAtPath(f"/{kind}/feathers/covert")
    assert not still.GetAttribute("velocities").HasAuthoredValue()


@pytest.mark.parametrize("kind", KINDS)
def test_default_value_is_the_rest_pose(caches, kind):
    cache = Cache(caches[kind])
    for index, entry in enumerate(feathers.entries()):
        rest = feathers.surface().points(entry.rest_points)
        np.testing.assert_allclose(cache.pose(index).points, rest, atol=1e-8)
        np.testing.assert_allclose(cache.feathers[index].rest, rest, atol=1e-8)
        labels = (entry.id, entry.kind, entry.region)
        found = cache.feathers[index]
        assert (found.id, found.kind, found.region) == labels


@pytest.mark.parametrize("kind", ["flat", "payload", "clips"])
def test_one_other_pose_throughout_needs_no_samples(tmp_path, kind):
    """Settled feathers: not at rest, yet still. One starts to move in the third chunk only."""
    path = tmp_path / "settled.usdc"
    with CacheWriter(
        path, feathers.entries(), (1, 6), options=WriteOptions(layout=kind, chunk=2)
    ) as writer:
        for number in range(1, 7):
            points = [pose.points for pose in feathers.frame(5).poses]
            velocities = [both(lambda part: np.full_like(part, 1e-9), p) for p in points]
            points[1] = feathers.placed((0, 0.1, 0), 0.05 * max(0, number - 4))
            writer.write(feathers.frame_of(number, 0.0, points, velocities))
    stage = Usd.Stage.Open(str(path))
    names = ("primary_1", "primary_1_2")
    still, late = (UsdGeom.Mesh.Get(stage, f"/settled/feathers/{name}") for name in names)
    assert not any(a.GetNumTimeSamples() for a in still.GetPrim().GetAttributes())
    pose = feathers.surface().points(feathers.frame(5).poses[0].points)
    rest = feathers.surface().points(feathers.entries()[0].rest_points)
    for code in (Usd.TimeCode.Default(), 1, 3.5, 6):
        np.testing.assert_allclose(still.GetPointsAttr().Get(code), pose, atol=1e-8)
    np.testing.assert_allclose(still.GetPrim().GetAttribute("primvars:rest").Get(), rest, atol=1e-8)
    assert late.GetPointsAttr().GetTimeSamples() == [1, 2, 3, 4, 5, 6]
    moved = feathers.surface().points(feathers.placed((0, 0.1, 0), 0.05))
    np.testing.assert_allclose(late.GetPointsAttr().Get(5), moved, atol=1e-8)
    at_rest = feathers.surface().points(feathers.placed((0, 0.1, 0)))
    np.testing.assert_allclose(late.GetPointsAttr().Get(3.5), at_rest, atol=1e-8)


def test_a_chunk_that_changes_before_the_root_is_written_stops_it(tmp_path):
    path = tmp_path / "out.usda"
    writer = CacheWriter(
        path, feathers.entries(), (1, 4), options=WriteOptions(layout="clips", chunk=2)
    )
    for number in range(1, 5):
        writer.write(feathers.frame(number))
    assert writer.samples_done == 4
    next(tmp_path.rglob("0001.usdc")).write_bytes(b"PXR-USDC")
    with pytest.raises(InputError, match=r"0001\.usdc: is not the chunk that was written"), writer:
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("each", "most", "chunks"), [(2, 9, 2), (2, 1, 4), (9, 9, 1)])
def test_chunks_grow_with_the_feathers_up_to_a_limit(tmp_path, monkeypatch, each, most, chunks):
    """each, most: frames for which the bytes suffice, by the number of feathers and in all."""
    entries = feathers.entries()
    frame = sum(f.bytes_per_sample for f in make_posed_feathers(entries, StageSpace(1.0, "Z")))
    monkeypatch.setattr(cache_writer, "_MIN_CHUNK_BYTES", 0)
    monkeypatch.setattr(cache_writer, "_BYTES_PER_FEATHER", each * frame // len(entries) + 1)
    monkeypatch.setattr(cache_writer, "_MAX_CHUNK_BYTES", most * frame)
    with CacheWriter(
        tmp_path / "a.usda", entries, (1, 4), options=WriteOptions(layout="clips")
    ) as writer:
        for number in range(1, 5):
            writer.write(feathers.frame(number))
    assert len(list(tmp_path.rglob("000?.usdc"))) == chunks


def test_memory_holds_one_chunk_whatever_the_number_of_frames(tmp_path):
    """Clips: the samples in memory never exceed those of a chunk."""
    most = 0
    with CacheWriter(
        tmp_path / "a.usda",
        feathers.entries(),
        (1, 40),
        options=WriteOptions(layout="clips", chunk=4),
    ) as writer:
        for number in range(1, 41):
            writer.write(feathers.frame(number))
            held = [
                layer
                for layer in Sdf.Layer.GetLoadedLayers()
                if layer.GetAttributeAtPath("/a/feathers/primary_1.points")
            ]
            most = max([most, *(len(layer.ListAllTimeSamples()) for layer in held)])
    assert most == 3  # the fourth completes the chunk, which is written and forgotten
    assert len(Cache(tmp_path / "a.usda").pose(0, 33.0).points)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells of a process's own memory")
def test_a_flat_file_is_put_together_without_its_samples_in_memory(tmp_path, monkeypatch):
    held = []

    def noting(function):
        def noted(*arguments, **more):
            function(*arguments, **more)
            told = Path("/proc/self/status").read_text()
            held.append(1024 * int(re.search(r"RssAnon:\s+(\d+) kB", told)[1]))

        return noted

    entries, path = writing_cost.entries(8), tmp_path / "a.usdc"
    rest = entries[0].feather.rest
    with CacheWriter(path, entries, (1, 48), options=WriteOptions(layout="flat")) as writer:
        for number in range(1, 49):
            writer.write(writing_cost.frame(number, rest, len(entries)))
        assert writer.samples_done == 48  # waits
        noting(lambda: None)()
        monkeypatch.setattr(chunks, "publish", noting(chunks.publish))
        monkeypatch.setattr(Parts, "finish", noting(Parts.finish))
    before, *later = held
    assert len(later) == 2
    assert max(later) - before < 0.3 * path.stat().st_size
    assert path.stat().st_size > 5e7


def test_subsets_cover_the_mesh_and_carry_materials(caches):
    stage = Usd.Stage.Open(str(caches["payload"]))
    mesh = UsdGeom.Mesh.Get(stage, "/payload/feathers/covert")
    subsets = UsdGeom.Subset.GetGeomSubsets(mesh, "face", "materialBind")
    part = feathers.surface().part
    for subset, side in zip(subsets, (0, 1, 2), strict=True):
        np.testing.assert_array_equal(subset.GetIndicesAttr().Get(), np.flatnonzero(part == side))
    assert UsdGeom.Subset.GetFamilyType(mesh, "materialBind") == "partition"
    valid, reason = UsdGeom.Subset.ValidateFamily(mesh, "face", "materialBind")
    assert valid, reason
    bound = [
        UsdShade.MaterialBindingAPI(s).ComputeBoundMaterial()[0].GetPath().name
        for s in (subsets[0].GetPrim(), subsets[2].GetPrim(), mesh.GetPrim())
    ]
    assert bound == ["vane", "rachis", "vane"]


def test_an_absent_vane_has_no_subset(tmp_path):
    surface = feathers.surface()
    keep = surface.part != 1
    bare = type(surface)(
        surface.row, surface.node, surface.offset, surface.triangles[keep], surface.part[keep],
        surface.barb_direction[keep], surface.st,
    )  # fmt: skip
    feather = feathers.feather()
    feather = type(feather)(**{**vars(feather), "surface": bare})
    entry = FeatherEntry("half", "k", "r", feather, feathers.placed((0, 0, 0)))
    with CacheWriter(tmp_path / "half.usda", [entry], None):
        pass
    assert set(Cache(tmp_path / "half.usda").feathers[0].subsets) == {"leadingVane", "rachis"}


def test_rachis_curve(caches):
    stage = Usd.Stage.Open(str(caches["usdc"]))
    curve = UsdGeom.BasisCurves.Get(stage, "/usdc/rachises/covert_rachis")
    assert curve.GetTypeAttr().Get() == "linear"
    np.testing.assert_allclose(curve.GetWidthsAttr().Get(), 2 * feathers.RADIUS)
    assert curve.ComputePurpose() == "guide"
    assert UsdGeom.Imageable.Get(stage, "/usdc/feathers/covert").ComputePurpose() == "default"
    code = Usd.TimeCode(3)
    moving = UsdGeom.BasisCurves.Get(stage, "/usdc/rachises/primary_1_rachis")
    from_usd = UsdGeom.Boundable.ComputeExtentFromPlugins(moving, code)
    np.testing.assert_allclose(moving.GetExtentAttr().Get(code), from_usd, atol=1e-8)


def test_barb_direction_follows_the_deformed_barbs(caches):
    cache = Cache(caches["usdc"])
    surface = feathers.surface()
    for code in (None, 1.0, 5.0):
        pose = cache.pose(0, code)
        angle = 0.0 if code is None else 0.4 * np.sin(5 * (code - 1) / 24) + 0.01
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0],
                         [-np.sin(angle), 0, np.cos(angle)]])  # fmt: skip
        np.testing.assert_allclose(pose.barb_direction, surface.barb_direction @ turn.T, atol=1e-5)


def test_normals_are_unit_and_dorsal(caches):
    cache = Cache(caches["usdc"])
    normals = cache.pose(2).normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    vane = np.unique(cache.feathers[2].triangles[cache.feathers[2].side < 2])
    np.testing.assert_allclose(normals[vane], [[0, 0, 1]] * len(vane), atol=1e-6)


@pytest.mark.parametrize(("unit", "axis"), [(0.01, "Y"), (0.01, "Z"), (1.0, "Y")])
def test_units_and_up_axis_are_converted(tmp_path, caches, unit, axis):
    path = tmp_path / "converted.usdc"
    with CacheWriter(
        path, feathers.entries(), (1, 5), 24.0, WriteOptions(meters_per_unit=unit, up_axis=axis)
    ) as writer:
        for number in range(1, 6):
            writer.write(feathers.frame(number))
    cache, plain = Cache(path), Cache(caches["usdc"])
    assert (cache.meters_per_unit, cache.up_axis) == (unit, axis)
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) if axis == "Y" else np.eye(3)
    pose, metres = cache.pose(0, 4.0), plain.pose(0, 4.0)
    np.testing.assert_allclose(pose.points, metres.points @ turn.T / unit, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        pose.velocities, metres.velocities @ turn.T / unit, rtol=1e-5, atol=1e-5
    )
    np.testing.assert_allclose(pose.normals, metres.normals @ turn.T, atol=1e-6)
    np.testing.assert_allclose(pose.barb_direction, metres.barb_direction @ turn.T, atol=1e-5)
    stage = Usd.Stage.Open(str(path))
    curve = UsdGeom.BasisCurves.Get(stage, "/converted/rachises/tail_rachis")
    np.testing.assert_allclose(curve.GetWidthsAttr().Get(), 2 * feathers.RADIUS / unit, rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_usd_validators_have_no_complaint(caches, kind):
    stage = Usd.Stage.Open(str(caches[kind]))
    assert feathers.usd_faults(stage) == []
    # The validators do look at these prims: a broken subset is an error.
    stage.SetEditTarget(stage.GetSessionLayer())
    subset = UsdGeom.Subset.Get(stage, f"/{kind}/feathers/covert/rachis")
    subset.GetIndicesAttr().Set([0, 1])
    assert feathers.usd_faults(stage)


def test_rest_only_has_no_time(tmp_path):
    path = tmp_path / "rest.usda"
    with CacheWriter(path, feathers.entries(), None):
        pass
    cache = Cache(path)
    assert not cache.has_frames
    assert "timeSamples" not in path.read_text()


def test_the_same_frames_give_the_same_bytes(tmp_path, caches):
    path = tmp_path / "usdc.usdc"
    with CacheWriter(path, feathers.entries(), (1, 5), 24.0, metadata={"shot": "s"}) as writer:
        for number in range(1, 6):
            writer.write(feathers.frame(number))
    assert path.read_bytes() == caches["usdc"].read_bytes()


def test_prim_names_are_valid_unique_and_stable():
    ids = ["a b", "a/b", "a_b", "1", "", "a b_2", "rächis"]
    names = unique_prim_names(ids)
    assert names == ["a_b_2", "a_b_3", "a_b", "_1", "_", "a_b_2_2", "r_chis"]
    assert len(set(names)) == len(ids)


def test_a_value_that_is_not_finite_names_the_feather(tmp_path):
    frame = feathers.frame(1)
    frame.poses[1].points.nodes[2, 2, 0] = np.nan
    path = tmp_path / "bad.usdc"
    with (
        pytest.raises(SimulationError, match="primary 1 at t = 0"),
        CacheWriter(path, feathers.entries(), (1, 5)) as writer,
    ):
        writer.write(frame)
    assert list(tmp_path.iterdir()) == []


def test_frames_come_in_turn(tmp_path):
    with CacheWriter(tmp_path / "a.usd", feathers.entries(), (1, 2)) as writer:
        with pytest.raises(ValueError, match="frame 2 is out of turn"):
            writer.write(feathers.frame(2))
        writer.write(feathers.frame(1))
        writer.write(feathers.frame(2))
        with pytest.raises(ValueError, match="frame 3 is out of turn"):
            writer.write(feathers.frame(3))
    assert Cache(tmp_path / "a.usd").frames == (1.0, 2.0)


@pytest.mark.parametrize("kind", KINDS)
def test_instances_of_a_cache_move(caches, kind):
    """As set dressing does it: a prim that references the cache, made an instance."""
    stage = Usd.Stage.CreateInMemory()
    for name in ("first", "second"):
        prim = stage.DefinePrim(f"/set/{name}")
        prim.GetReferences().AddReference(str(caches[kind]))
        prim.SetInstanceable(True)
    plain = Usd.Stage.Open(str(caches[kind]))
    assert stage.GetPrimAtPath("/set/first").IsInstance()
    compared = 0
    for prim in plain.Traverse():
        if not prim.IsA(UsdGeom.PointBased):
            continue
        below = str(prim.GetPath()).removeprefix(f"/{kind}/")
        same = stage.GetPrimAtPath(f"/set/second/{below}")
        assert same.IsInstanceProxy()
        for name in ("points", "extent", "velocities"):
            for code in (1.0, 2.25, 3.0, 5.0):
                wanted = prim.GetAttribute(name).Get(code)
                assert same.GetAttribute(name).Get(code) == wanted
                compared += wanted is not None
    assert compared > 50
