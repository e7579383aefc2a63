"""Feathers that share prims: what is in the files, and that readers and bakes find each of them."""

from __future__ import annotations

import re
import tracemalloc
from dataclasses import replace
from pathlib import Path

import feathers
import numpy as np
import pytest
import trimesh
from places import ROOT
from pxr import Sdf, Usd, UsdGeom, UsdShade

from featherfx.errors import InputError, SimulationError
from featherfx.feather.types import both
from featherfx.usd.check.check import check_usd
from featherfx.usd.check.measures import count_crossings
from featherfx.usd.convert.condensed import export_condensed
from featherfx.usd.convert.merge import flatten, join_shares
from featherfx.usd.convert.mesh_files import mesh_sequence
from featherfx.usd.read.cache import Cache
from featherfx.usd.types import StageSpace
from featherfx.usd.write import posed_groups as joined
from featherfx.usd.write.cache_writer import CachePlace, CacheWriter, Continuation
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.output import CacheForm, choose_group, group_feathers
from featherfx.usd.write.poses import make_posed_feathers
from featherfx.usd.write.previous_cache import PreviousCache

GROUPS = ("kind", "region", "all")
SETTINGS = {"shot": "one"}


def of(settings, **place):
    """What a writer is told of a bake of these settings."""
    place, goes_on = CachePlace("bird", **place), Continuation(settings)
    return {"place": place, "continuation": goes_on, "metadata": {"settings": settings}}


def counted_entries():
    pairs = zip(feathers.entries(), (40, 40, 7, 0), strict=True)
    return [replace(entry, barb_count=count) for entry, count in pairs]


def write(path: Path, group: str, chosen=None, **more) -> Path:
    """Five frames of some of the four feathers."""
    entries = more.pop("entries", counted_entries())
    chosen = range(len(entries)) if chosen is None else chosen
    given = more.pop("given", None) or of(SETTINGS)
    options = WriteOptions(**{"chunk": 2, "group": group, **more})
    own = [entries[k] for k in chosen]
    with CacheWriter(path, own, (1, 5), 24.0, options, **given) as writer:
        for number in range(1, 6):
            frame = feathers.frame(number)
            writer.write(replace(frame, poses=tuple(frame.poses[k] for k in chosen)))
    return path


@pytest.fixture(scope="module")
def single(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("single") / "single.usda", "feather")


@pytest.fixture(scope="module", params=[(g, "flat") for g in GROUPS] + [("region", "clips")])
def shared(request, tmp_path_factory) -> Path:
    group, layout = request.param
    path = tmp_path_factory.mktemp("shared") / f"{group}.usda"
    return write(path, group, layout=layout, accelerations=True, diagnostics=("strain",))


def prims(stage, *schemas) -> list:
    return [p for p in stage.Traverse() if any(p.IsA(each) for each in schemas)]


@pytest.mark.parametrize(
    ("group", "names"),
    [
        ("feather", ["primary_1", "primary_1_2", "covert", "tail"]),
        ("kind", ["primary", "covert", "tail_feather"]),
        ("region", ["left_wing", "body", "tail"]),
        ("all", ["all"]),
    ],
)
def test_prims_of_each_grouping(tmp_path, group, names):
    stage = Usd.Stage.Open(str(write(tmp_path / "o.usda", group)))
    assert [p.GetName() for p in prims(stage, UsdGeom.Mesh)] == names
    curves = [p.GetName() for p in prims(stage, UsdGeom.BasisCurves)]
    assert curves == [f"{name}_rachis" for name in names]


def test_many_feathers_go_by_region_and_those_without_one_by_kind():
    assert (choose_group(None, 200), choose_group(None, 201)) == ("feather", "region")
    assert choose_group("kind", 3) == "kind"
    entries = [replace(each, region="") for each in feathers.entries()[:3]]
    entries.append(replace(feathers.entries()[3], region="covert"))
    # a region may have the name of a kind
    assert group_feathers(entries, "region") == [("primary", (0, 1)), ("covert", (2, 3))]
    assert all(each.name.endswith("2of3") for each in group_feathers(entries, "region", "2of3"))


def test_readers_find_each_feather_as_if_it_stood_alone(single, shared):
    one, many = Cache(single), Cache(shared)
    assert sorted(f.id for f in many.feathers) == sorted(f.id for f in one.feathers)
    assert len({f.name for f in many.feathers}) == 4
    assert sorted(f.barb_count for f in many.feathers) == [0, 7, 40, 40]
    for index, feather in enumerate(many.feathers):
        other = next(k for k, each in enumerate(one.feathers) if each.id == feather.id)
        alone = one.feathers[other]
        for name in ("kind", "region", "barb_count"):
            assert getattr(feather, name) == getattr(alone, name)
        assert feather.is_feather
        for name in ("triangles", "side", "face", "rest", "st", "colour"):
            np.testing.assert_array_equal(getattr(feather, name), getattr(alone, name))
        assert feather.subsets.keys() == alone.subsets.keys()
        for name, faces in alone.subsets.items():
            np.testing.assert_array_equal(feather.subsets[name], faces)
        for code in (None, 1.0, 2.0, 2.5, 5.0):
            mine, own = many.pose(index, code), one.pose(other, code)
            np.testing.assert_array_equal(mine.points, own.points)
            np.testing.assert_array_equal(mine.normals, own.normals)
            np.testing.assert_array_equal(mine.barb_direction, own.barb_direction)
            # what never moves has no velocities where it is alone
            expected = 0.0 if own.velocities is None else own.velocities
            if code is not None and mine.velocities is not None:
                np.testing.assert_array_equal(mine.velocities, np.zeros((36, 3)) + expected)
    for chosen in (range(4), [3, 0, 1, 2], [2], [1, 1, 3]):
        for index, points in zip(chosen, many.points_of(chosen, 2.0), strict=True):
            np.testing.assert_allclose(points, many.pose(index, 2.0).points, atol=1e-6)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (500.0, -300.0, 20.0)])
@pytest.mark.parametrize("accelerations", [False, True])
def test_feathers_posed_together_have_the_bits_of_each_alone(
    tmp_path, monkeypatch, origin, accelerations
):
    monkeypatch.setattr(joined, "_MAX_JOINED", 3)  # two blocks
    entries = [replace(each, static=False) for each in feathers.entries()]
    own = {"entries": entries, "accelerations": accelerations}
    paths = [
        write(tmp_path / f"{group}.usdc", group, given=of(SETTINGS, origin=origin), **own)
        for group in ("feather", "all")
    ]
    one, many = map(Cache, paths)
    layers = [Sdf.Layer.FindOrOpen(str(path)) for path in paths]
    names = ["points", "velocities", "normals", "primvars:barbDirection"]
    names += ["accelerations"] * accelerations
    for code in range(1, 6):
        for name in names:
            for scope, end in (("feathers", ""), ("rachises", "_rachis")):
                if name not in ("points", "velocities", "accelerations") and end:
                    continue
                whole = layers[1].QueryTimeSample(f"/bird/{scope}/all{end}.{name}", code)
                # of the two that move; the others have no samples of their own
                each = [
                    layers[0].QueryTimeSample(f"/bird/{scope}/{own}{end}.{name}", code)
                    for own in ("primary_1", "primary_1_2")
                ]
                parts = np.concatenate([np.asarray(part) for part in each])
                np.testing.assert_array_equal(np.asarray(whole)[: len(parts)], parts)
    for index in range(4):
        np.testing.assert_array_equal(many.pose(index, 3.0).points, one.pose(index, 3.0).points)


def test_a_plain_reader_finds_one_feather_by_its_primvar_and_its_ranges(shared):
    """What docs/usd.md says, in plain USD."""
    expected = {e.id: e for e in feathers.entries()}
    stage = Usd.Stage.Open(str(shared))
    for prim in prims(stage, UsdGeom.Mesh):
        mesh = UsdGeom.Mesh(prim)
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId")
        assert primvar.GetInterpolation() == "uniform"
        of_face = list(primvar.ComputeFlattened())
        assert len(of_face) == len(mesh.GetFaceVertexCountsAttr().Get())
        ids = list(primvar.Get())
        points = prim.GetAttribute("featherRange:points").Get()
        faces = prim.GetAttribute("featherRange:faces").Get()
        for id, (start, count), (first, number) in zip(ids, points, faces, strict=True):
            assert of_face[first : first + number] == [id] * number
            rest = np.array(mesh.GetPointsAttr().Get())[start : start + count]
            entry = expected[id]
            np.testing.assert_allclose(
                rest, entry.feather.surface.points(entry.rest_points), atol=1e-8
            )
    for prim in prims(stage, UsdGeom.BasisCurves):
        curves, api = UsdGeom.BasisCurves(prim), UsdGeom.PrimvarsAPI(prim)
        assert len(curves.GetCurveVertexCountsAttr().Get()) == len(api.GetPrimvar("up").Get())
        assert api.GetPrimvar("up").GetInterpolation() == "uniform"
        assert len(api.GetPrimvar("featherId").ComputeFlattened()) == len(
            prim.GetAttribute("featherRange:curves").Get()
        )


def test_the_page_on_usd_tells_how_one_feather_is_hidden_and_shaded(tmp_path):
    page = (ROOT / "docs/usd.md").read_text()
    code = {"UsdGeom": UsdGeom, "UsdShade": UsdShade}
    exec(re.search(r"```python\n(def faces_of.*?)```", page, re.DOTALL)[1], code)
    stage = Usd.Stage.Open(str(write(tmp_path / "o.usda", "all")))
    (mesh,) = map(UsdGeom.Mesh, prims(stage, UsdGeom.Mesh))
    triangles = len(feathers.surface().triangles)
    assert code["faces_of"](mesh, "covert") == list(range(2 * triangles, 3 * triangles))
    material = UsdShade.Material.Define(stage, "/bird/materials/red")
    code["shade"](mesh, "covert", material)
    assert UsdGeom.Subset.ValidateFamily(mesh, "face", "materialBind")[0]
    subset = stage.GetPrimAtPath(mesh.GetPath().AppendChild("chosen"))
    assert (
        UsdShade.MaterialBindingAPI(subset).ComputeBoundMaterial()[0].GetPath()
        == material.GetPath()
    )
    for feather in ("tail", "covert"):
        code["hide"](mesh, feather)
    assert list(mesh.GetHoleIndicesAttr().Get()) == list(range(2 * triangles, 4 * triangles))


@pytest.mark.parametrize("hooked", [False, True])
def test_hooks_of_a_group_are_told_for_all_of_its_faces(tmp_path, hooked):
    triangles = len(feathers.surface().triangles)
    held = np.linspace(0.5, 1.0, triangles)
    entries = feathers.entries()
    entries[0] = replace(entries[0], held=held)
    entries[1] = replace(entries[1], hooked=hooked)
    path = write(tmp_path / "o.usda", "all", entries=entries)
    assert check_usd(path) == []
    stage = Usd.Stage.Open(str(path))
    (mesh,) = prims(stage, UsdGeom.Mesh)
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("hooked")
    assert bool(primvar.GetTimeSamples()) == hooked
    np.testing.assert_allclose(primvar.Get(2.0), [*held, *np.ones(3 * triangles)], rtol=1e-6)


def test_the_checks_accept_what_is_written_and_find_damaged_tables(shared, tmp_path):
    assert check_usd(shared) == []
    path = flatten(shared, tmp_path / "plain.usda")
    assert check_usd(path) == []
    layer, stage = Sdf.Layer.FindOrOpen(str(path)), Usd.Stage.Open(str(path))
    (mesh,) = (
        prim
        for prim in prims(stage, UsdGeom.Mesh)
        if len(prim.GetAttribute("featherRange:points").Get()) > 1
    )
    table = layer.GetAttributeAtPath(mesh.GetPath().AppendProperty("featherRange:points"))
    table.default = type(table.default)([(0, 30), (30, 30)])
    layer.Save()
    assert any("featherRange" in f"{each.key} {each.message}" for each in check_usd(path))
    with pytest.raises(InputError, match="featherRange"):
        Cache(path)


def test_what_moves_has_samples_of_constant_length_and_what_rests_none(shared):
    stage = Usd.Stage.Open(str(shared))
    for prim in prims(stage, UsdGeom.Mesh, UsdGeom.BasisCurves):
        points = prim.GetAttribute("points")
        ids = set(UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId").Get())
        moves = bool(ids & {"primary/1", "primary 1"})
        assert points.GetTimeSamples() == ([1.0, 2.0, 3.0, 4.0, 5.0] if moves else [])
        assert len({len(points.Get(code)) for code in range(1, 6)}) == 1
        for name in ("faceVertexIndices", "primvars:rest", "primvars:st", "primvars:featherId"):
            assert prim.GetAttribute(name).GetNumTimeSamples() == 0


def test_other_forms_have_a_prim_a_feather(shared, tmp_path):
    names = {f.name for f in Cache(shared).feathers}
    assert export_condensed(shared, tmp_path / "condensed.usda") == 4
    stage = Usd.Stage.Open(str(tmp_path / "condensed.usda"))
    assert {p.GetName() for p in stage.Traverse() if p.IsA(UsdGeom.BasisCurves)} == names
    (written,) = mesh_sequence(shared, tmp_path / "o.glb", [2.0])
    assert set(trimesh.load(written).geometry) == names


def test_crossings_count_pairs_of_feathers_that_share_a_mesh(tmp_path):
    entries = feathers.entries()[:2]
    turned = both(lambda part: part[..., [0, 2, 1]] * (1, -1, 1), entries[1].rest_points)
    entries[1] = replace(entries[1], rest_points=turned.shifted(np.array([0.0, -0.1, 0.0])))
    told = []
    for group in ("feather", "all"):
        path = tmp_path / f"{group}.usda"
        with CacheWriter(path, entries, None, options=WriteOptions(group=group)):
            pass
        told.append(list(count_crossings(path)))
    assert told[0] == told[1]


def parts_of(tmp_path: Path, group: str, shares, **options) -> list[Path]:
    files = []
    for number, chosen in enumerate(shares, 1):
        path = tmp_path / f"bird.{number}of{len(shares)}.usdc"
        own = of({**SETTINGS, "feathers": f"{number}"}, part=f"{number}of{len(shares)}")
        files.append(write(path, group, chosen, given=own, **options))
    return files


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("shares", [[(0, 2), (1, 3)], [(0,), (1,), (2, 3)]])
def test_shares_are_taken_over_with_the_bytes_of_a_whole(tmp_path, group, shares):
    whole = write(tmp_path / "whole.usdc", group)
    files = parts_of(tmp_path, group, shares, layout="clips")
    path = tmp_path / "merged.usdc"
    options = WriteOptions(chunk=2, group=group)
    given = of(SETTINGS)
    with CacheWriter(path, counted_entries(), (1, 5), 24.0, options, **given) as out:
        for file, chosen in zip(files, shares, strict=True):
            out.take_over(PreviousCache(file), chosen)
        for number in range(1, 6):
            out.write(replace(feathers.frame(number), poses=()))
    assert path.read_bytes() == whole.read_bytes()


def test_joined_shares_hold_every_feather_once(tmp_path, single):
    files = parts_of(tmp_path, "region", [(0, 2), (1, 3)])
    path = tmp_path / "bird.usda"
    assert join_shares(path, files) == 4
    assert sorted(f.id for f in Cache(path).feathers) == sorted(
        f.id for f in Cache(single).feathers
    )
    assert check_usd(path) == []


def test_a_feather_that_is_not_finite_is_named(tmp_path):
    frame = feathers.frame(1)
    bad = both(lambda part: np.where(part == 0.0, np.nan, part), frame.poses[1].points)
    poses = (frame.poses[0], frame.poses[1]._replace(points=bad), *frame.poses[2:])
    options = WriteOptions(group="all")
    with (
        pytest.raises(SimulationError, match="primary 1"),
        CacheWriter(tmp_path / "o.usda", feathers.entries(), (1, 5), 24.0, options) as writer,
    ):
        writer.write(replace(frame, poses=poses))
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_grouping_is_refused(tmp_path):
    with pytest.raises(InputError, match="'flock' is not one of feather, kind, region, all"):
        CacheWriter(
            tmp_path / "o.usda", feathers.entries(), None, options=WriteOptions(group="flock")
        )


def traced(make) -> tuple[object, int]:
    """What is made, and bytes that Python and numpy hold of it."""
    tracemalloc.start()
    try:
        made = make()
        return made, tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()


def test_feathers_of_a_coat_cost_little_beside_their_numbers():
    one = feathers.entries()[0]
    many = [replace(one, id=f"contour_{number}") for number in range(300)]
    form = CacheForm.of(WriteOptions(form="condensed"))
    make_posed_feathers(many[:1], StageSpace(), form=form)  # what all share
    posed, held = traced(lambda: make_posed_feathers(many, StageSpace(), form=form))
    assert held < 1000 * len(many)
    group = joined.PosedGroup(group_feathers(many, "all")[0], posed, [False] * len(many), False)
    group.new_pose()
    # its numbers are in USD's own memory
    _, held = traced(group.new_pose)
    assert held < 50 * len(many)
