"""Groom files: what they give, and what is said when they are wrong."""

from __future__ import annotations

import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from featherfx.errors import InputError, InputWarning
from featherfx.groom.read.read import read_groom
from featherfx.groom.types import Groom
from featherfx.shot.read.read import check_file

ROW = """
[[row]]
id = "right_primary"
kind = "swan_primary"
count = 5
first = { position = [0, -1, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
last = { position = [0, -2, 0], direction = [0, -1, 0], up = [0, 0, 1] }
"""


def write(folder: Path, text: str, name: str = "groom.toml") -> Path:
    path = folder / name
    path.write_text('name = "test"\n' + text, encoding="utf-8")
    return path


def groom_of(folder: Path, text: str) -> Groom:
    return read_groom(write(folder, text))


def feather(name: str, more: str = "") -> str:
    return f'[[feather]]\nid = "{name}"\nkind = "covert"\nposition = [0, 0, 0]\n{more}\n'


def found(folder: Path, text: str) -> list[str]:
    path = write(folder, text)
    with pytest.raises(InputError) as caught:
        read_groom(path)
    assert list(caught.value.problems) == check_file(path)
    return [str(each).replace(f"{folder}/", "") for each in caught.value.problems]


def assert_rotation(rotation: np.ndarray) -> None:
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_single_feather_stands_along_its_direction(tmp_path: Path) -> None:
    more = "direction = [0, -2, 0]\nup = [0, 1, 3]\nregion = 'wing'"
    placed = groom_of(tmp_path, feather("a", more)).feathers[0]
    assert (placed.id, placed.region, placed.joint, placed.mirrored) == ("a", "wing", "", False)
    np.testing.assert_allclose(placed.rotation[:, 0], (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(placed.rotation[:, 2], (0, 0, 1), atol=1e-12)
    assert_rotation(placed.rotation)


def test_angles_turn_about_x_then_y_then_z(tmp_path: Path) -> None:
    placed = groom_of(tmp_path, feather("a", "rotation = [90, 0, 90]")).feathers[0]
    np.testing.assert_allclose(placed.rotation @ (0, 1, 0), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(placed.rotation @ (1, 0, 0), (0, 1, 0), atol=1e-12)


def test_roll_lifts_the_leading_vane_on_both_sides(tmp_path: Path) -> None:
    more = "direction = [-1, 0, 0]\nup = [0, 0, 1]\nroll = 30\nmirror = 'y'"
    right, left = groom_of(tmp_path, feather("right", more)).feathers
    assert (left.id, right.mirrored, left.mirrored) == ("left", False, True)
    assert (right.rotation @ (0, 1, 0))[2] == pytest.approx(0.5)
    assert (left.rotation @ (0, -1, 0))[2] == pytest.approx(0.5)


def test_mirror_image_is_the_reflection_of_the_feather(tmp_path: Path) -> None:
    groom = groom_of(tmp_path, ROW + "mirror = 'y'\nroll = 12\nlift = 0.002\n")
    by_id = {each.id: each for each in groom.feathers}
    assert len(by_id) == 10
    reflect = np.array([1.0, -1.0, 1.0])
    in_feather = np.array([0.3, 0.05, -0.02])  # a point near the leading edge
    for number in range(1, 6):
        right, left = by_id[f"right_primary_{number:02d}"], by_id[f"left_primary_{number:02d}"]
        assert_rotation(left.rotation)
        assert (right.mirrored, left.mirrored) == (False, True)
        seen = right.position + right.rotation @ in_feather
        mirrored = left.position + left.rotation @ (in_feather * reflect)
        np.testing.assert_allclose(mirrored, seen * reflect, atol=1e-12)
        assert right.kind is left.kind


def test_leading_vane_of_a_right_wing_points_outwards(tmp_path: Path) -> None:
    placed = groom_of(tmp_path, ROW).feathers[0]
    np.testing.assert_allclose(placed.rotation[:, 1], (0, -1, 0), atol=1e-12)


def test_row_turns_at_an_equal_rate_and_spreads_its_roots(tmp_path: Path) -> None:
    feathers = groom_of(tmp_path, ROW + "scale = [1.0, 0.6]\n").feathers
    along = np.array([each.rotation[:, 0] for each in feathers])
    angles = np.degrees(np.arctan2(-along[:, 1], -along[:, 0]))
    np.testing.assert_allclose(angles, [0, 22.5, 45, 67.5, 90], atol=1e-9)
    np.testing.assert_allclose([each.position[1] for each in feathers], -np.linspace(1, 2, 5))
    np.testing.assert_allclose(
        [each.kind.length for each in feathers], 0.35 * np.linspace(1, 0.6, 5)
    )
    diameters = [each.kind.rachis.diameter_base for each in feathers]
    np.testing.assert_allclose(diameters, 5.4e-3 * np.linspace(1, 0.6, 5))


def test_overlap_lifts_each_root_over_the_one_before(tmp_path: Path) -> None:
    feathers = groom_of(tmp_path, ROW + "lift = 0.002\n").feathers
    np.testing.assert_allclose([each.position[2] for each in feathers], 0.002 * np.arange(5))


def test_spacing_of_a_row(tmp_path):
    even = groom_of(tmp_path, ROW).feathers
    wide = groom_of(tmp_path, ROW + "spacing = 3.0\n").feathers
    gaps = np.linalg.norm(np.diff([f.position for f in wide], axis=0), axis=1)
    assert gaps[-1] / gaps[0] == pytest.approx(3.0)
    assert np.allclose(np.diff(gaps), (gaps[-1] - gaps[0]) / (len(gaps) - 1))
    for end in (0, -1):
        assert np.allclose(even[end].position, wide[end].position)


def test_row_along_a_path(tmp_path: Path) -> None:
    feathers = groom_of(tmp_path, ROW + "path = [[0, 0, 0], [1, 0, 0], [1, -3, 0]]\n").feathers
    expected = [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -2, 0], [1, -3, 0]]
    np.testing.assert_allclose([each.position for each in feathers], expected, atol=1e-12)


def test_kinds_are_assigned_in_order_or_blended(tmp_path: Path) -> None:
    text = ROW.replace('"swan_primary"\ncount', '["covert", "body_contour"]\ncount')
    lengths = [each.kind.length for each in groom_of(tmp_path, text).feathers]
    assert lengths == [0.11, 0.11, 0.11, 0.06, 0.06]
    lengths = [each.kind.length for each in groom_of(tmp_path, text + "blend = true\n").feathers]
    np.testing.assert_allclose(lengths, np.linspace(0.11, 0.06, 5))


def test_overrides_by_id_come_over_those_of_the_row(tmp_path: Path) -> None:
    text = ROW + "overrides = { rachis.camber = 5, calamus = 0.2 }\n"
    text += '[overrides]\n"*_0[12]" = { rachis.camber = 7, scale = 2 }\n'
    feathers = groom_of(tmp_path, text).feathers
    assert [each.kind.rachis.camber for each in feathers] == [7, 7, 5, 5, 5]
    assert [each.kind.length for each in feathers] == [0.7, 0.7, 0.35, 0.35, 0.35]
    assert {each.kind.calamus for each in feathers} == {0.2}
    assert {each.kind.rachis.sweep for each in feathers} == {12.0}


def test_material_of_one_feather_can_be_changed(tmp_path: Path) -> None:
    text = feather("a", "overrides.vane_material.shear_modulus = 5.0") + feather("b")
    first, second = groom_of(tmp_path, text).feathers
    assert (first.kind.vane_material.shear_modulus, second.kind.vane_material.shear_modulus) == (
        5.0,
        2.78e4,
    )
    assert (
        first.kind.vane_material.modulus_along_barbs
        == second.kind.vane_material.modulus_along_barbs
    )


def test_variation_depends_on_seed_and_id_alone(tmp_path: Path) -> None:
    spread = "[variation]\nseed = {}\nlength = 0.1\ncamber = 3\nroll = 4\nwidth = 0.05\n"
    many = "".join(feather(f"f{number}") for number in range(300))
    whole = {each.id: each for each in groom_of(tmp_path, many + spread.format(1)).feathers}
    alone = groom_of(tmp_path, feather("f7") + spread.format(1)).feathers[0]
    other = groom_of(tmp_path, feather("f7") + spread.format(2)).feathers[0]
    assert alone.kind == whole["f7"].kind
    np.testing.assert_array_equal(alone.rotation, whole["f7"].rotation)
    assert other.kind.length != alone.kind.length
    factors = np.array([each.kind.length for each in whole.values()]) / 0.11
    assert np.mean(factors) == pytest.approx(1.0, abs=0.02)
    assert np.std(factors) == pytest.approx(0.1, rel=0.15)


def test_matter_varies_as_measured_and_nothing_else_with_it(tmp_path: Path) -> None:
    """Slopes of samples within a quarter of the middle one: half of that is two deviations."""
    many = "".join(feather(f"f{number}") for number in range(300))
    sizes = "[variation]\nlength = 0.1\n"
    spread = (
        sizes
        + "modulus_across_barbs = 0.12\nmodulus_along_barbs = 0.12\n"
        + "thickness = 0.12\nbarb_angle = 2\n"
    )
    plain, varied = (groom_of(tmp_path, many + text).feathers for text in (sizes, spread))
    for name in ("modulus_across_barbs", "modulus_along_barbs", "thickness"):
        pairs = zip(varied, plain, strict=True)
        found = [getattr(a.kind.vane_material, name) / getattr(b.kind.vane_material, name)
                 for a, b in pairs]  # fmt: skip
        assert np.mean(found) == pytest.approx(1.0, abs=0.02)
        assert np.std(found) == pytest.approx(0.12, rel=0.15)
    first = [(a.kind.length, a.kind.vane_material.surface_density) for a in varied]
    assert first == [(a.kind.length, a.kind.vane_material.surface_density) for a in plain]
    angles = [[g.angle for g in each.kind.leading.guides] for each in varied]
    turned = np.array(angles) - [g.angle for g in plain[0].kind.leading.guides]
    assert np.ptp(turned, axis=1).max() < 1e-9
    assert np.std(turned[:, 0]) == pytest.approx(2.0, rel=0.15)
    shared = groom_of(tmp_path, many + spread + "variants = 5\n").feathers
    assert len({each.kind.vane_material.modulus_across_barbs for each in shared}) == 5


def test_stiffness_and_weight_vary_apart(tmp_path: Path) -> None:
    many = "".join(feather(f"f{number}") for number in range(300))
    spread = "[variation]\nstiffness = 0.1\nweight = 0.05\nbarb_angle = 2\n"
    plain = groom_of(tmp_path, feather("f7")).feathers[0].kind
    kinds = [each.kind for each in groom_of(tmp_path, many + spread).feathers]
    young, mass = np.array(
        [(k.rachis_material.youngs_modulus, k.rachis_material.cortex_density) for k in kinds]
    ).T / [[plain.rachis_material.youngs_modulus], [plain.rachis_material.cortex_density]]
    vanes = [k.vane_material.surface_density / plain.vane_material.surface_density for k in kinds]
    np.testing.assert_allclose(vanes, mass, rtol=1e-12)
    assert [young.std(), mass.std()] == pytest.approx([0.1, 0.05], rel=0.15)
    angles = [each.leading.guides[0].angle for each in kinds]
    assert np.abs(np.corrcoef([young, mass, angles]) - np.eye(3)).max() < 0.2
    assert groom_of(tmp_path, feather("f7") + spread).feathers[0].kind == kinds[7]


def test_equal_feathers_share_their_kind(tmp_path: Path) -> None:
    feathers = groom_of(tmp_path, ROW).feathers
    assert len({id(each.kind) for each in feathers}) == 1


def test_joints_are_mirrored_with_their_parents(tmp_path: Path) -> None:
    text = """
[[joint]]
name = "body"
position = [0, 0, 0]
[[joint]]
name = "right_shoulder"
position = [0, -0.1, 0]
parent = "body"
role = "shoulder"
side = "right"
mirror = "y"
[[joint]]
name = "right_wrist"
position = [0, -0.5, 0]
parent = "right_shoulder"
role = "wrist"
side = "right"
mirror = "y"
"""
    groom = groom_of(tmp_path, text + ROW + "joint = 'right_wrist'\nmirror = 'y'\n")
    joints = {each.name: each for each in groom.joints}
    wrist = joints["left_wrist"]
    assert (wrist.parent, wrist.role, wrist.side) == ("left_shoulder", "wrist", 1)
    assert joints["left_shoulder"].parent == "body"
    np.testing.assert_allclose(wrist.position, (0, 0.5, 0))
    assert {each.joint for each in groom.feathers if each.mirrored} == {"left_wrist"}


def test_all_problems_at_once(tmp_path: Path) -> None:
    text = feather("a", "up = [0, 0, 1]\ndirection = [0, 0, 2]") + feather("b", "scal = 2")
    text += feather("b", "joint = 'hip'") + feather("b")
    text += feather("c").replace("covert", "cover") + feather("d", "scale = nan")
    text += ROW.replace("count = 5", "count = 0").replace("[-1, 0, 0]", "[0, 0]")
    text += '[overrides]\n"x*" = { length = 99 }\n"zz" = { length = 1 }\n'
    assert found(tmp_path, text) == [
        "groom.toml: feather[1].scal: unknown key, did you mean 'scale'?",
        "groom.toml: feather[5].scale: nan is not a finite number",
        "groom.toml: row[0].count: 0 is out of range. Give 1 to 100000",
        "groom.toml: row[0].first.direction: has 2 items. Give 3 numbers",
        'groom.toml: overrides."x*".length: 99 is out of range. Give 0.001 to 5 m',
        "groom.toml: feather[0].up: is parallel to direction. Give another vector",
        'groom.toml: overrides."zz": matches no feather id, ids are like b, b, c',
        "groom.toml: feather[3].id: 'b' is taken already, by feather[2]",
        "groom.toml: feather[2].joint: no joint 'hip', there are none",
        "groom.toml: feather[4].kind: no feather preset 'cover', did you mean 'covert'?",
    ]


def test_no_feathers(tmp_path: Path) -> None:
    assert "there are no feathers" in found(tmp_path, "[variation]\nseed = 1\n")[0]


def test_joint_faults(tmp_path: Path) -> None:
    joint = '[[joint]]\nname = "{}"\nposition = [0, 0, 0]\nparent = "{}"\n'
    text = joint.format("a", "b") + joint.format("b", "a") + joint.format("c", "d")
    problems = found(tmp_path, text + joint.format("c", "") + feather("x"))
    assert "groom.toml: joint[3].name: 'c' is taken by joint[2]. Choose another" in problems
    assert (
        "groom.toml: joint[0].parent: joint cycle: a -> b -> a. Give one of them another parent"
        in problems
    )
    assert any("joint[2].parent: no joint 'd'" in each for each in problems)


def test_a_mirrored_feather_of_the_other_side_than_its_name_is_told(tmp_path: Path) -> None:
    left = feather("left_one", "mirror = 'y'")
    with pytest.warns(
        InputWarning, match=r"feather\[0\]: 'left_one' is a feather of the right side"
    ):
        groom_of(tmp_path, left)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        groom = groom_of(tmp_path, left + "side = 'left'\n")
    assert {each.id: each.mirrored for each in groom.feathers} == {
        "left_one": True,
        "right_one": False,
    }


def test_mirror_needs_a_side_in_the_name(tmp_path: Path) -> None:
    assert 'must hold "left" or "right"' in found(tmp_path, feather("a", "mirror = 'y'"))[0]


def test_blends_have_the_profiles_of_both(tmp_path: Path) -> None:
    folder = tmp_path / "presets" / "feather"
    folder.mkdir(parents=True)
    text = "rachis_material.modulus_profile = {}\nvane_material.along_barbs_profile.barb = {}\n"
    for name, curve in (("one", "[[0, 1], [1, 3]]"), ("other", "[[0.5, 2]]")):
        (folder / f"{name}.toml").write_text(f'base = "primary"\n{text.format(curve, curve)}')
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[row]]\nid = "r"\nkind = ["one", "other"]\ncount = 3\nblend = true\n'
        "first = { position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }\n"
        "last = { position = [0, 1, 0], direction = [1, 0, 0], up = [0, 0, 1] }\n"
    )
    middle = read_groom(tmp_path / "groom.toml", [tmp_path / "presets"]).feathers[1].kind
    halfway = ((0.0, 1.5), (0.5, 2.0), (1.0, 2.5))
    assert middle.rachis_material.modulus_profile == halfway
    assert middle.vane_material.along_barbs_profile.barb == halfway


def test_blend_of_unlike_kinds(tmp_path: Path) -> None:
    text = ROW.replace('"swan_primary"\ncount', '["swan_primary", "covert"]\ncount')
    problems = found(tmp_path, text + "blend = true\n")
    assert problems == [
        "groom.toml: row[0].blend: 'swan_primary' and 'covert' cannot be blended: their outlines "
        "or guides differ in number"
    ]


def test_bad_toml_names_file_and_line(tmp_path: Path) -> None:
    problems = found(tmp_path, "count = = 3\n")
    assert len(problems) == 1
    assert problems[0].startswith("groom.toml: not valid TOML, line 2, column")


@pytest.mark.parametrize("value", ["1" + "0" * 400, "1" + "0" * 5000, "[" * 2000, "inf", "1e999"])
def test_absurd_numbers_and_nesting(tmp_path: Path, value: str) -> None:
    assert len(found(tmp_path, feather("a", f"scale = {value}"))) == 1


@pytest.mark.parametrize("name", ["a.csv", "a.npz"])
def test_empty_table_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("")
    assert found(tmp_path, TABLE.format(name))[0].startswith(f"{name}: ")


def test_table_with_a_header_alone_has_no_feathers(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(HEADER)
    assert "there are no feathers" in found(tmp_path, TABLE.format("a.csv"))[0]


def test_missing_file_is_one_problem(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_groom(tmp_path / "nowhere.toml")
    assert [each.message for each in caught.value.problems] == [
        "there is no such file. Check the path"
    ]
    assert [each.message for each in check_file(tmp_path)] == ["is a folder, expects a TOML file"]


def test_a_file_of_something_else(tmp_path: Path) -> None:
    path = tmp_path / "cargo.toml"
    path.write_text("[package]\n")
    assert "no shot, groom or preset" in check_file(path)[0].message


HEADER = "id,kind,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z,scale,region\n"
TABLE = '[[table]]\nfile = "{}"\n'


def test_csv_and_npz_give_the_same_feathers(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(HEADER + "p,covert,1,2,3,-1,0,0,0,0,1,0.5,back\n")
    np.savez(
        tmp_path / "a.npz",
        id=np.array(["p"]),
        kind=np.array(["covert"]),
        position=[[1.0, 2.0, 3.0]],
        direction=[[-1.0, 0.0, 0.0]],
        up=[[0.0, 0.0, 1.0]],
        scale=[0.5],
        region=np.array(["back"]),
    )
    first = groom_of(tmp_path, TABLE.format("a.csv")).feathers[0]
    second = groom_of(tmp_path, TABLE.format("a.npz")).feathers[0]
    assert (first.id, first.kind, first.region) == (second.id, second.kind, second.region)
    assert first.kind.length == 0.055
    np.testing.assert_array_equal(first.rotation, second.rotation)
    np.testing.assert_array_equal(first.position, (1, 2, 3))


def test_table_faults_name_row_and_column(tmp_path: Path) -> None:
    rows = ["p,covert,1,2,3,-1,0,0,0,0,1,1,", "q,covert,1,nan,3,-1,0,0,0,0,1,0,", ""]
    (tmp_path / "a.csv").write_text(HEADER + "\n".join(rows))
    (tmp_path / "b.csv").write_text(HEADER + "p,covert,1,x,3,-1,0,0,0,0,1,1,\n")
    (tmp_path / "c.csv").write_text(HEADER + "p,cover,1,2,3,-1,0,0,2,0,0,1,\n")
    (tmp_path / "d.csv").write_text("id,kind,x,y,colour\nq,covert,1,2,red\n")
    text = "".join(TABLE.format(f"{name}.csv") for name in "abcde")
    problems = found(tmp_path, text)
    for expected in (
        "a.csv: row 2.y: nan is not a finite number",
        "a.csv: row 2.scale: 0 is out of range. Give 0.01 to 100",
        "b.csv: row 1.y: 'x' is not a number",
        "c.csv: row 1.up_x: up is zero or parallel to direction",
        "d.csv: z: there is no such column. Add it to the table",
        "e.csv: there is no such file. Check the path",
    ):
        assert expected in problems
    assert any(each.startswith("d.csv: colour: unknown column") for each in problems)


def test_many_faults_of_a_table_stay_readable(tmp_path: Path) -> None:
    rows = [f"f{n},covert,nan,2,3,-1,0,0,0,0,1,1,back" for n in range(1000)]
    (tmp_path / "a.csv").write_text(HEADER + "\n".join(rows))
    problems = found(tmp_path, TABLE.format("a.csv"))
    assert len(problems) == 21
    assert problems[-1] == "a.csv: x: and 980 more rows with the same fault"


def test_unknown_kind_and_joint_in_a_table_are_said_once(tmp_path: Path) -> None:
    rows = [f"f{n},cover,1,2,3,-1,0,0,0,0,1,1,back" for n in range(50)]
    (tmp_path / "a.csv").write_text(HEADER + "\n".join(rows))
    problems = found(tmp_path, TABLE.format("a.csv") + 'joint = "hip"\n')
    assert len(problems) == 2


def test_a_table_of_25000_feathers_is_read_in_seconds(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    place = generator.normal(size=(25_000, 3))
    lines = [
        f"f{n},covert,{x:.6f},{y:.6f},{z:.6f},-1,0,{0.3 * x:.6f},0,0.1,1,1,back"
        for n, (x, y, z) in enumerate(place)
    ]
    (tmp_path / "a.csv").write_text(HEADER + "\n".join(lines))
    path = write(tmp_path, TABLE.format("a.csv") + "[overrides]\n'f1*' = { rachis.camber = 9 }\n")
    start = time.process_time()
    groom = read_groom(path)
    assert time.process_time() - start < 3.0
    assert len(groom.feathers) == 25_000
    assert len({id(each.kind) for each in groom.feathers}) == 2
