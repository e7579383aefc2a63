"""Wind and colliders from USD, what a bake writes of the skin, and the figures of the page."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdin_scenes import (
    TYPES,
    add_curves,
    add_matrix,
    add_mesh,
    arc,
    lifted,
    new_stage,
    rigid,
    sheet,
    vec,
    write_shot,
)

import featherfx
from featherfx.baking.pipeline import check, export_groom
from featherfx.errors import InputError, InputWarning

WIND = '[wind_usd]\nusd = "air.usda"\nprim = "/air"\n'


def refused(path):
    with pytest.raises(InputError) as caught:
        featherfx.read_shot(path)
    return str(caught.value)


def with_frames(path, last):
    """The same shot, longer, beside it."""
    longer = path.with_name("longer.toml")
    longer.write_text(path.read_text().replace("frames = [1, 25]", f"frames = [1, {last}]"))
    return longer


def test_one_vector_for_all(tmp_path):
    stage = new_stage(tmp_path / "air.usda", 0.01, "Y")
    air = UsdGeom.Xform.Define(stage, "/air")
    add_matrix(air, rigid(90, (0, 1, 0), (5, 5, 5)))
    attribute = air.GetPrim().CreateAttribute("wind", TYPES.Vector3f)
    attribute.Set((100, 0, 0), 1)
    attribute.Set((300, 0, 0), 25)
    air.GetPrim().CreateAttribute("label", TYPES.String).Set("calm")
    stage.Save()
    path = write_shot(tmp_path, None, more='attribute = "wind"\n')
    text = path.read_text().replace('attribute = "wind"\n', "")
    path.write_text(text + WIND + 'attribute = "wind"\nscale = 2\n')
    wind = featherfx.read_shot(path).wind_source
    # turned about y, x goes to -z of the stage, which is y of the world
    for seconds, speed in ((0.0, 2.0), (0.5, 4.0), (1.0, 6.0)):
        found = wind.velocity(np.zeros((2, 3)), seconds)
        np.testing.assert_allclose(found, [[0, speed, 0]] * 2, atol=1e-6)
    path.write_text(text + WIND + 'attribute = "label"\n')
    assert "/air.label is not one vector, of finite numbers" in refused(path)
    path.write_text(text + WIND + 'attribute = "gust"\n')
    assert "no attribute 'gust' on /air. Attributes of one vector: wind" in refused(path)
    path.write_text(text + WIND)
    assert "/air holds no points. Give attribute" in refused(path)


def test_a_field_of_points(tmp_path):
    """Between points the nearest count most; at a point its own value holds."""
    stage = new_stage(tmp_path / "air.usda")
    air = UsdGeom.Points.Define(stage, "/air")
    random = np.random.default_rng(3)
    points, velocities = random.uniform(-1, 1, (200, 3)), random.normal(size=(200, 3))
    for frame, factor in ((1, 1.0), (25, 3.0)):
        air.CreatePointsAttr().Set(vec(points), frame)
        air.CreateVelocitiesAttr().Set(vec(factor * velocities), frame)
    stage.Save()
    path = write_shot(tmp_path, None)
    path.write_text(path.read_text() + WIND)
    wind = featherfx.read_shot(path).wind_source
    np.testing.assert_allclose(wind.velocity(points[:9], 0.0), velocities[:9], atol=1e-5)
    np.testing.assert_allclose(wind.velocity(points[:9], 0.5), 2 * velocities[:9], atol=1e-5)
    with pytest.warns(InputWarning, match=r"/air has samples from 1 to 25, the shot needs 1 to 49"):
        featherfx.read_shot(with_frames(path, 49))
    between = wind.velocity(random.uniform(-1, 1, (50, 3)), 0.0)
    assert (between <= velocities.max(axis=0) + 1e-5).all()
    assert (between >= velocities.min(axis=0) - 1e-5).all()
    air.GetVelocitiesAttr().Set(vec(velocities[:5]), 25)
    stage.Save()
    assert "/air at time code 25: 200 points and 5 velocities" in refused(path)


def test_a_scenes_wind_at_each_root_is_added_to_the_wind_of_the_shot(tmp_path):
    from featherfx.shot.loads import frame_loads

    stage = new_stage(tmp_path / "air.usda")
    air = UsdGeom.Points.Define(stage, "/air")
    air.CreatePointsAttr(vec([[0, 0, 0], [1, 0, 0]]))
    air.CreateVelocitiesAttr(vec([[0, 0, 1], [0, 0, 3]]))
    stage.Save()
    path = write_shot(tmp_path, None, more='[wind]\nbase = "breeze"\ngust = 0\n')
    path.write_text(path.read_text() + WIND)
    shot = featherfx.read_shot(path)
    feathers = featherfx.build(shot.groom, shot.quality)[:2]
    points = [each.points for each in feathers]
    roots = np.array([[0, 0, 0], [1.0, 0, 0]])
    loads = frame_loads(shot, [], feathers, points, 0.0, 1 / 24, roots)
    np.testing.assert_allclose(loads.wind_mean, [[3, 0, 1], [3, 0, 3]], atol=1e-6)


def test_colliders_by_path_name_and_collection(tmp_path):
    stage = new_stage(tmp_path / "set.usda")
    points, counts, quads = sheet()
    for name in ("ground", "rock_1", "rock_2", "tree"):
        add_mesh(stage, f"/set/{name}", points, counts, quads)
    group = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/set"), "colliders")
    group.CreateIncludesRel().SetTargets(["/set/tree", "/set/ground"])
    stage.Save()
    path = write_shot(tmp_path, None)
    head = path.read_text() + '[[collider]]\nusd = "set.usda"\n'
    for keys, names in {
        'prims = ["/set/ground", "rock_*"]': ["ground", "rock_1", "rock_2"],
        'collection = "/set.collection:colliders"': ["ground", "tree"],
    }.items():
        path.write_text(head + keys + "\n")
        colliders = featherfx.read_shot(path).colliders
        assert [each.surface.path for each in colliders] == [f"/set/{name}" for name in names]
        np.testing.assert_allclose(colliders[0].points(1.0), points, atol=1e-7)
        assert len(colliders[0].surface.triangles) == 2 * len(counts)
    for keys, words in {
        "": "names neither prims nor a collection",
        'prims = ["cliff"]': r"collider[0].prims[0]: no mesh is called 'cliff'",
        'prims = ["tree*", "/set/hill"]': "collider[0].prims[1]: no prim /set/hill",
        'collection = "/set.collection:walls"': "no collection 'walls' on /set, there is colliders",
    }.items():
        path.write_text(head + keys + "\n")
        assert words in refused(path)


def test_colliders_move_in_the_time_of_their_scene(tmp_path):
    """Samples at 1001 to 1025, the shot at 1 to 25: start says so, else the nearest is held."""
    stage = new_stage(tmp_path / "set.usda")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/rock", None, counts, quads)
    for code, height in ((1001, 0.0), (1025, 0.5)):
        mesh.CreatePointsAttr().Set(vec(lifted(points, height)), code)
    stage.Save()
    path = write_shot(tmp_path, None)
    text = path.read_text() + '[[collider]]\nusd = "set.usda"\nprims = ["/rock"]\n'
    path.write_text(text + "start = 1001\n")
    (rock,) = featherfx.read_shot(path).colliders
    for time, height in ((0.0, 0.0), (0.5, 0.25), (1.0, 0.5)):
        np.testing.assert_allclose(rock.points(time), lifted(points, height), atol=1e-6)
    path.write_text(text)
    with pytest.warns(InputWarning, match=r"collider\[0\]: /rock has samples from 1001 to 1025"):
        (rock,) = featherfx.read_shot(path).colliders
    np.testing.assert_allclose(rock.points(1.0), points, atol=1e-6)


def test_a_bake_follows_the_skin_and_says_where_roots_sit(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/bird/skin", None, counts, quads)
    for frame in (1, 2, 3):
        mesh.CreatePointsAttr().Set(vec(lifted(points, 0.001 * (frame - 1))), frame)
    stage.Save()
    shot = write_shot(tmp_path, 'usd = "skin.usda"\nprim = "/bird/skin"', (1, 3))
    featherfx.bake(shot, tmp_path / "out.usda")
    assert check(tmp_path / "out.usda") == []
    cache = Usd.Stage.Open(str(tmp_path / "out.usda"))
    meshes = [UsdGeom.Mesh(prim) for prim in cache.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 5
    groom = featherfx.read_groom(tmp_path / "groom.toml")
    for each, placement in zip(meshes, groom.feathers, strict=True):
        primvars = UsdGeom.PrimvarsAPI(each)
        value = {
            n: primvars.GetPrimvar(n).Get()
            for n in ("skinPrim", "skinFace", "skinPoints", "skinBarycentric")
        }
        assert list(value["skinPrim"]) == ["/bird/skin"]
        assert set(value["skinPoints"]) <= set(quads[value["skinFace"][0]])
        on_skin = np.array(value["skinBarycentric"]) @ points[list(value["skinPoints"])]
        np.testing.assert_allclose(on_skin[:2], placement.position[:2], atol=1e-6)
    shaft = next(p for p in cache.Traverse() if p.IsA(UsdGeom.BasisCurves))
    roots = [UsdGeom.BasisCurves(shaft).GetPointsAttr().Get(f)[0] for f in (1, 2, 3)]
    np.testing.assert_allclose(np.diff([root[2] for root in roots]), 0.001, atol=1e-6)


@pytest.mark.parametrize("asked", [{}, {"up_axis": "Z", "meters_per_unit": 1.0}])
def test_a_bake_has_the_units_and_axis_of_its_skin(tmp_path, asked):
    """A skin in centimetres with y up; a root stands where its skin point stands in the stage."""
    stage = new_stage(tmp_path / "skin.usda", 0.01, "Y")
    points, counts, quads = sheet()
    turned = points[:, [0, 2, 1]] * [100.0, 100.0, -100.0]
    add_mesh(stage, "/bird/skin", turned, counts, quads)
    stage.Save()
    shot = write_shot(tmp_path, 'usd = "skin.usda"\nprim = "/bird/skin"', (1, 2))
    report = featherfx.bake(shot, tmp_path / "out.usda", **asked).report
    parts = ["setting_up", "settling", "simulating", "writing", "finishing"]
    assert list(report["seconds"]) == parts
    assert all(seconds >= 0.0 for seconds in report["seconds"].values())
    assert sum(report["seconds"].values()) == pytest.approx(report["wall_seconds"])
    cache = Usd.Stage.Open(str(tmp_path / "out.usda"))
    unit, axis = UsdGeom.GetStageMetersPerUnit(cache), str(UsdGeom.GetStageUpAxis(cache))
    assert (unit, axis) == ((1.0, "Z") if asked else (0.01, "Y"))
    mesh = next(p for p in cache.Traverse() if p.IsA(UsdGeom.Mesh))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    corners = list(primvars.GetPrimvar("skinPoints").Get())
    weights = np.array(primvars.GetPrimvar("skinBarycentric").Get())
    name = mesh.GetName() + "_rachis"
    shaft = UsdGeom.BasisCurves(cache.GetPrimAtPath(f"/out/rachises/{name}"))
    place = weights @ (points if asked else turned)[corners]
    across = [0, 1] if asked else [0, 2]
    root = np.array(shaft.GetPointsAttr().Get(1))[0]
    np.testing.assert_allclose(root[across], place[across], atol=1e-5 if asked else 1e-3)


def test_rest_feathers_have_the_units_of_the_groom_that_they_come_from(tmp_path):
    stage = new_stage(tmp_path / "bird.usda", 0.01, "Y")
    add_curves(stage, "/bird", [100.0 * arc()])
    stage.Save()
    count = export_groom(tmp_path / "bird.usda", tmp_path / "rest.usda", render_rows=9, barbs=5)
    assert count == 1
    cache = Usd.Stage.Open(str(tmp_path / "rest.usda"))
    assert UsdGeom.GetStageMetersPerUnit(cache) == 0.01
    assert UsdGeom.GetStageUpAxis(cache) == "Y"
    rachis = UsdGeom.BasisCurves(cache.GetPrimAtPath("/rest/rachises/bird_rachis"))
    barbs = UsdGeom.BasisCurves(cache.GetPrimAtPath("/rest/barbs/bird_barbs"))
    assert len(rachis.GetPointsAttr().Get()) == 9
    assert len(barbs.GetCurveVertexCountsAttr().Get()) > 5
    assert check(tmp_path / "rest.usda") == []


# anonymous memory only: pages of the file that USD maps are the system's to take back
BIG = """
import sys, time
import featherfx

def mebibytes(field):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field)) / 1024

start = time.process_time()
shot = featherfx.read_shot(sys.argv[1])
read = time.process_time() - start
shot.skin.frames(0.0)  # which loads what compiles kernels
before = mebibytes("RssAnon")
for frame in range(240):
    shot.skin.frames(frame / 24.0)
print(read, time.process_time() - start, before, mebibytes("RssAnon"), mebibytes("VmHWM"))
"""


def big_scene(folder, frames):
    folder.mkdir()
    points, counts, quads = sheet(400, 250, 1.0)
    stage = new_stage(folder / "skin.usdc")
    mesh = add_mesh(stage, "/bird/skin", None, counts, quads)
    for frame in range(1, frames + 1):
        wave = 0.02 * np.sin(20 * points[:, 0] + 0.2 * frame)
        mesh.CreatePointsAttr().Set(vec(points + np.outer(wave, [0, 0, 1])), frame)
    stage.Save()
    random = np.random.default_rng(5)
    roots = random.uniform(-0.49, 0.49, (5000, 3)) * [1, 1, 0]
    roots[:, 2] = 0.02 * np.sin(20 * roots[:, 0] + 0.2)
    np.savez(
        folder / "roots.npz",
        id=np.array([f"f{k}" for k in range(5000)]),
        position=roots,
        direction=np.tile([1.0, 0, 0.2], (5000, 1)),
        up=np.tile([0, 0, 1.0], (5000, 1)),
    )
    (folder / "g.toml").write_text('name = "g"\n[[table]]\nfile = "roots.npz"\nkind = "covert"\n')
    skin = 'usd = "skin.usdc"\nprim = "/bird/skin"\nextrapolation = "hold"'
    return write_shot(folder, skin, (1, 240), groom="g.toml")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="measures memory by /proc")
def test_a_large_skin_is_quick_and_memory_is_flat(tmp_path):
    figures = []
    for frames in (24, 240):
        shot = big_scene(tmp_path / str(frames), frames)
        command = [sys.executable, "-c", BIG, str(shot)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        figures.append([float(word) for word in done.stdout.split()])
    print(
        "processor s to read, and with all frames, MiB then, MiB at the end, MiB with mapped pages",
        figures,
    )
    (_, _, _, small, _), (read, whole, before, large, _) = figures
    assert read < 10
    assert whole < 20
    assert large < before + 20
    assert large < small + 20
