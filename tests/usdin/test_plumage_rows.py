"""Rows along curves and joints, and kinds that mix within a region."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel
from regions_skin import grown, problems, region, roots, skin_folder, write_skin
from usdin_scenes import add_mesh, new_stage

import featherfx
from featherfx.errors import InputError

__all__ = ["skin_folder"]


ROOT = "{ position = [0, 0, 0], direction = [-1, 0, 0], up = [0, 0, 1] }"
ROW = f"""[[row]]
id = "primary"
kind = "swan_primary"
count = 5
first = {ROOT}
last = {ROOT}
"""


def test_a_row_along_a_curve(tmp_path):
    write_skin(tmp_path, meters_per_unit=0.01)
    curve = "curve = { usd = 'skin.usda', prim = '/guides/line' }\n"
    positions = roots(grown(tmp_path, ROW + curve, skin="name = 'wing'\n"))
    # 0.1 units of a centimetre long, in five roots at equal distances
    assert positions[:, 0] == pytest.approx(-0.001 * np.linspace(0, 1, 5))
    assert positions[:, 2] == pytest.approx(0.001)


def test_roots_turn_with_their_curve(tmp_path):
    """Along a wing's edge, straight and then bent, the shafts stand square to it."""
    turn = np.linspace(0, np.pi / 2, 41)
    bend = np.column_stack([-1 - np.sin(turn), np.cos(turn) - 1, np.zeros(41)])
    edge = np.vstack([[0, 0, 0], bend])
    row = ROW.replace(f"first = {ROOT}", f"first = {ROOT.replace('-1, 0, 0', '0, 1, 0')}")
    row = row.replace("count = 5", "count = 41") + f"path = {edge.tolist()}\n"
    apart = []
    for keys in ("", "turn_with_path = true\n"):
        feathers = grown(tmp_path, row + keys, skin="name = 'wing'\n").feathers
        shafts = np.array([f.rotation[:, 0] for f in feathers])
        square = np.array([np.minimum(f.position - [-1, -1, 0], [0, 9, 0]) for f in feathers])
        square /= np.linalg.norm(square, axis=1, keepdims=True)
        apart.append(np.degrees(np.arccos(np.clip((shafts * square).sum(axis=1), -1, 1))))
        assert np.allclose([f.rotation[:, 2] for f in feathers], [0, 0, 1], atol=1e-9)
    assert apart[0].max() > 20.0
    assert apart[1].max() < 2.5


def test_the_file_of_a_curve_is_an_input(tmp_path):
    write_skin(tmp_path)
    groom = tmp_path / "groom.toml"
    groom.write_text(
        "name = 'wing'\n" + ROW + "curve = { usd = 'skin.usda', prim = '/guides/line' }\n"
    )
    with pytest.raises(InputError, match=r"skin\.usda: is an input"):
        featherfx.export_groom(groom, tmp_path / "skin.usda", overwrite=True)


def test_a_row_along_a_curve_that_is_not_there(folder):
    missing = problems(folder, ROW + "curve = { usd = 'skin.usda', prim = '/nothing' }\n")
    assert "row[0].curve.prim" in missing
    skin = problems(folder, ROW + "curve = { usd = 'skin.usda', prim = '/skin' }\n")
    assert "no curves at /skin" in skin
    path = "path = [[0, 0, 0], [1, 0, 0]]\n"
    both = problems(folder, ROW + path + "curve = { usd = 'skin.usda', prim = '/guides/line' }\n")
    assert "stands beside path" in both


def write_skeleton(folder):
    stage = new_stage(folder / "bones.usda", 0.01)
    skeleton = UsdSkel.Skeleton.Define(stage, "/bird/skeleton")
    UsdGeom.Xformable(stage.DefinePrim("/bird", "Xform")).AddTranslateOp().Set((0, 0, 50))
    skeleton.CreateJointsAttr(["arm", "arm/hand", "arm/hand/tip", "leg", "leg/tip"])
    places = [(0, 0, 0), (10, 0, 0), (10, 20, 0), (0, 0, -5), (0, 0, -9)]
    matrices = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*place)) for place in places]
    skeleton.CreateBindTransformsAttr(matrices)
    skeleton.CreateRestTransformsAttr(matrices)
    stage.GetRootLayer().Save()


def on_joints(*names):
    return (
        "curve = { usd = 'bones.usda', prim = '/bird/skeleton', joints = "
        + str(list(names))
        + " }\n"
    )


def test_a_row_along_the_joints_of_a_skeleton(tmp_path):
    write_skeleton(tmp_path)
    row = ROW.replace("count = 5", "count = 4") + on_joints("arm", "hand", "arm/hand/tip")
    positions = roots(grown(tmp_path, row, skin="name = 'wing'\n"))
    # 0.1 m along the arm, then 0.2 m along the hand, 0.5 m above the ground
    wanted = [[0, 0, 0.5], [0.1, 0, 0.5], [0.1, 0.1, 0.5], [0.1, 0.2, 0.5]]
    assert np.allclose(positions, wanted)


def test_a_row_along_joints_goes_on_to_the_end_of_the_last_bone(tmp_path):
    write_skeleton(tmp_path)
    row = ROW.replace("count = 5", "count = 4") + on_joints("arm", "hand")
    wanted = [[0, 0, 0.5], [0.1, 0, 0.5], [0.1, 0.1, 0.5], [0.1, 0.2, 0.5]]
    assert np.allclose(roots(grown(tmp_path, row, skin="name = 'wing'\n")), wanted)
    short = row.replace("joints =", "tail = false, joints =")
    positions = roots(grown(tmp_path, short, skin="name = 'wing'\n"))
    assert np.allclose(positions[-1], [0.1, 0, 0.5])


def test_the_last_bone_of_all_ends_where_its_skin_does(tmp_path):
    write_skeleton(tmp_path)
    row = ROW + on_joints("leg", "leg/tip")
    bare = roots(grown(tmp_path, row, skin="name = 'wing'\n"))
    assert np.allclose(bare[-1], [0, 0, 0.41])
    stage = Usd.Stage.Open(str(tmp_path / "bones.usda"))
    UsdSkel.Root.Define(stage, "/bird")
    points = [(0, 0, -6), (1, 0, -10), (0, 1, -12), (0, 5, 10)]
    mesh = add_mesh(stage, "/bird/skin", points, [3, 3], [0, 1, 2, 1, 2, 3])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/bird/skeleton"])
    # the last point hangs on the arm
    binding.CreateJointIndicesPrimvar(False, 1).Set([3, 4, 4, 0])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 4)
    stage.Save()
    clothed = roots(grown(tmp_path, row, skin="name = 'wing'\n"))
    assert np.allclose(clothed[-1], [0, 0, 0.38])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("arm", "hnad"), "no joint 'hnad', did you mean 'hand'"),
        (("arm", "wing"), "no joint 'wing', known: arm, arm/hand/tip, hand, leg, leg/tip"),
        (("arm", "tip"), "may be arm/hand/tip, leg/tip"),
        (("arm",), "expects two or more of /bird/skeleton, known: arm, arm/hand"),
        (("arm", "arm"), "are at one place"),
    ],
)
def test_joints_that_make_no_line(tmp_path, names, message):
    write_skeleton(tmp_path)
    assert message in problems(tmp_path, ROW + on_joints(*names), skin="name = 'wing'\n")


def test_joints_of_a_curve_are_refused(folder):
    curve = "curve = { usd = 'skin.usda', prim = '/guides/line', joints = ['a', 'b'] }\n"
    assert "is no Skeleton" in problems(folder, ROW + curve)


MIXED = "kind = [{ name = 'body_contour', share = 3 }, { name = 'covert'%s }]\n"


def of_kinds(where=""):
    return region(keys="count = 400").replace("kind = 'body_contour'\n", MIXED % where)


def test_kinds_mix_by_their_shares(folder):
    groom = grown(folder, of_kinds())
    covert = np.array([f.kind.name == "covert" for f in groom.feathers])
    # binomial, three standard deviations
    assert abs(covert.mean() - 0.25) < 3 * np.sqrt(0.25 * 0.75 / 400)
    # each as long as its own kind, where the region gives no length
    lengths = np.array([f.kind.length for f in groom.feathers])
    assert np.allclose(lengths, np.where(covert, 0.11, 0.06))
    plain = grown(folder, region(keys="count = 400"))
    assert [f.id for f in plain.feathers] == [f.id for f in groom.feathers]
    assert np.array_equal(roots(plain), roots(groom))


def test_kinds_by_names_alone_are_of_equal_share(folder):
    named = region(keys="count = 400").replace("'body_contour'", "['body_contour', 'covert']")
    covert = np.array([f.kind.name == "covert" for f in grown(folder, named).feathers])
    assert abs(covert.mean() - 0.5) < 3 * np.sqrt(0.25 / 400)


def test_maps_choose_kinds(folder):
    groom = grown(folder, of_kinds(", where = [{ x = [0, 1] }]"))
    x = roots(groom)[:, 0]
    covert = np.array([f.kind.name == "covert" for f in groom.feathers])
    assert not covert[x < 0].any()
    assert covert[x > 0].mean() == pytest.approx(0.25, abs=0.1)
    # a kind whose share is 0 all around leaves the place to the first
    none = grown(folder, of_kinds(", where = [{ x = [5, 6] }]"))
    assert {f.kind.name for f in none.feathers} == {"body_contour"}


def test_kinds_that_are_wrong(folder):
    mixed = of_kinds(", where = [{ x = [1, 0] }], share = -1").replace("body_contour", "bdoy")
    found = problems(folder, mixed)
    assert "region[0].kind[1].share" in found
    sound = of_kinds(", where = [{ x = [1, 0] }]").replace("body_contour", "bdoy")
    found = problems(folder, sound)
    assert "Give the lower bound first" in found
    assert "bdoy" in found
    nothing = region().replace("'body_contour'", "[{ name = 'covert', share = 0 }]")
    assert "no share above 0" in problems(folder, nothing)
