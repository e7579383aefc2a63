"""Whole birds from landmarks of their bodies, and what is wrong with landmarks."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crossed import crossed
from places import SAMPLES
from pxr import Usd, UsdGeom

from featherfx.api import scene_readers
from featherfx.errors import InputError, InputWarning
from featherfx.feather.leaves import lay_out
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.anatomy import drape
from featherfx.groom.anatomy.bird_tracts import axes_of
from featherfx.groom.anatomy.remiges import folded, lying
from featherfx.groom.anatomy.wing import BENT_HEIGHT, wing_type
from featherfx.groom.keys.anatomy import TRACTS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.library import Library
from featherfx.groom.read.read import read_groom as read_groom_file
from featherfx.groom.skin.skin import Body
from featherfx.shot.motion.flap import PIGEON, beat_of, build_of, size_of
from featherfx.shot.read.reference import list_presets

BIRD = SAMPLES / "first_bird"
TEXT = (BIRD / "groom.toml").read_text()


def read_groom(path):
    """A groom as it is placed, before its layout."""
    return read_groom_file(path, (), scene_readers())


def changed(folder: Path, old: str, new: str) -> Path:
    """The sample's groom with lines that match `old` changed, beside the sample's body."""
    text = re.sub(old, new, TEXT, flags=re.M).replace("body.usdc", str(BIRD / "body.usdc"))
    path = folder / "groom.toml"
    path.write_text(text, encoding="utf-8")
    return path


def scarce(density: float, *but: str) -> str:
    """Keys of a type by which its tracts, but some, grow few feathers: scattering takes seconds."""
    names = (part for part in TRACTS if part not in but)
    return ", ".join(f"tracts.{part}.relative_density = {density}" for part in names)


BARE = scarce(0)
NO_QUILLS = ", ".join(f"wing.{row}.count = 0" for row in ("primaries", "secondaries", "tertials"))
MANY_QUILLS = (
    f'type = {{ base = "pigeon", wing.base = "pigeon", wing.primaries.count = 90, {BARE} }}'
)


@pytest.fixture(scope="module")
def bird():
    return read_groom(BIRD / "groom.toml")


@pytest.fixture
def wings_as_typed(monkeypatch):
    """Folded wings stay where their type has them: to find how they lie takes 5 s and more."""
    monkeypatch.setattr("featherfx.groom.anatomy.bird._lying", lambda wings, *_: wings)


def test_a_skin_and_landmarks_are_a_whole_bird(bird):
    count = Counter(feather.region for feather in bird.feathers)
    assert set(TRACTS) <= set(count)
    assert (count["primaries"], count["secondaries"], count["tail"]) == (20, 20, 12)
    assert bird.layout is not None
    lines = [line for line in TEXT.splitlines() if line and line[0] not in "#["]
    assert len(lines) <= 40


def test_the_sample_is_the_pigeon_that_motions_were_set_on(bird):
    build = build_of(bird)
    assert tuple(build) == pytest.approx(tuple(PIGEON), rel=0.06)
    assert (size_of(build), beat_of(build)) == pytest.approx((1.0, 1.0), abs=0.03)


def test_parts_are_where_their_names_say(bird):
    middle = {
        part: np.mean([f.position for f in bird.feathers if f.region == part], axis=0)
        for part in TRACTS
    }
    order = [middle[part][0] for part in ("face", "nape", "mantle", "back", "rump")]
    assert order == sorted(order, reverse=True)
    assert middle["throat"][2] > middle["foreneck"][2] > middle["breast"][2] > middle["belly"][2]
    assert all(abs(place[1]) < 0.01 for place in middle.values())


def test_folded_wings_lie_along_the_flanks(bird):
    for side, sign in (("right", -1.0), ("left", 1.0)):
        wing = [f for f in bird.feathers if f.id.startswith(f"{side}_wing_primary")]
        for feather in wing:
            assert feather.rotation[0, 0] < -0.9  # backwards
            assert sign * feather.rotation[1, 2] > 0.5  # the upper side outwards
            assert sign * feather.position[1] > 0.03


def test_folded_wings_lie_on_the_body_and_meet_on_the_back(bird):
    body = Body(bird.skin, np.eye(3), np.zeros(3))
    for side, sign in (("right", -1.0), ("left", 1.0)):
        arm = [f for f in bird.feathers if re.match(f"{side}_wing_(secondary|tertial)", f.id)]
        ways = np.linspace(0, 1, 5)[:, None]
        shafts = np.array([f.position + f.kind.length * ways * f.rotation[:, 0] for f in arm])
        gaps = body.gaps(shafts.reshape(-1, 3))
        assert gaps.min() > 0.0
        # of the length of the body; nearer, remiges cut through the coat beneath
        assert gaps.mean() < 0.055 * 0.3
        # the vane of the innermost tertial, a sixth of its length wide, reaches onto the back
        edges = sign * shafts[:, :, 1] - np.array([[f.kind.length / 6.0] for f in arm])
        assert 0.0 < edges.min() < 0.012


def test_a_folded_wing_lies_with_its_front_on_the_breast_and_its_tip_over_the_tail(bird):
    body = Body(bird.skin, np.eye(3), np.zeros(3))
    longest = max(f.kind.length for f in bird.feathers if "wing_primary" in f.id)
    for side, sign in (("right", -1.0), ("left", 1.0)):
        arm = [f for f in bird.feathers if re.match(f"{side}_wing_(secondary|tertial)", f.id)]
        front = [f for f in bird.feathers if f"{side}_wing_median_covert" in f.id]
        gaps = []
        for flight, covert in zip(arm, front, strict=True):
            # what the rows between take up is no gap
            above = (covert.position - flight.position) @ flight.rotation[:, 2]
            gaps.append(body.gaps(covert.position[None] - above * flight.rotation[:, 2])[0])
        assert np.mean(gaps) < 0.05 * longest
        assert body.gaps(np.array([f.position for f in front])).mean() < 0.08 * longest
        tips = np.array([tip(f) for f in bird.feathers if f"{side}_wing_primary" in f.id])
        over = tips[tips[:, 0] < -0.134]  # behind the root of the tail
        assert len(over) > 3
        tail = 0.138 + (0.205 - 0.138) / (0.055 + 0.134) * (over[:, 0] + 0.134)
        assert (over[:, 2] > tail).all()
        assert (sign * over[:, 1] > 0.0).all()


def test_the_small_coverts_of_a_shut_wing_are_a_coat_that_covers_its_front(bird):
    """Bare quills of the row behind stood above the back and the breast."""
    laid = lay_out(bird)
    coat = [f for f in laid.feathers if f.leaf is not None]
    own = [f for f in coat if re.match("(right|left)_wing_lesser_covert", f.id)]
    assert len(own) > 40
    points = np.concatenate([f.position + rest.nodes[:, 0] @ f.rotation.T
                             for f, rest in rests_of(coat)])  # fmt: skip
    fronts = [f for f in laid.feathers if "_wing_median_covert" in f.id]
    for front in fronts:
        ways = (points - front.position) @ front.rotation
        beside = np.linalg.norm(ways[:, :2], axis=1) < 0.25 * front.kind.length
        assert 0.0 < ways[beside, 2].max() < 0.3 * front.kind.length


def rests_of(placements):
    """Placements and the rest shapes of their rachises."""
    return [
        (f, each.rest)
        for f, each in zip(placements, build_feathers(placements, 11, 4), strict=True)
    ]


@pytest.mark.usefixtures("wings_as_typed")
def test_the_small_coverts_of_a_wing_that_opens_are_rows(tmp_path):
    kind = f'type = {{ base = "pigeon", {BARE} }}\n'
    for opens, rows in (("", 0), ("opens = true", 4)):
        found = read_groom(changed(tmp_path, "^type.*", kind + opens)).feathers
        names = {f.region for f in found if "right_wing_lesser" in f.id}
        assert len([each for each in names if each.startswith("lesser_covert_")]) == rows
        assert ("right_wing_lesser_covert_1" in names) == (not rows)


def test_feathers_stand_below_the_lower_edge_of_a_folded_wing_and_scapulars_on_the_back(bird):
    centres = bird.skin.mean(axis=1)
    normals = np.cross(bird.skin[:, 1] - bird.skin[:, 0], bird.skin[:, 2] - bird.skin[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    coat = np.array([f.position for f in bird.feathers if f.region in TRACTS])
    for edge in (f for f in bird.feathers if f.id.endswith("wing_secondary_01")):
        for part in (0.2, 0.4, 0.6):
            place = edge.position + part * edge.kind.length * edge.rotation[:, 0]
            skin = centres[np.argmin(np.linalg.norm(centres - place, axis=1))]
            assert np.linalg.norm(coat - skin, axis=1).min() < 0.012
    scapulars = [f.position for f in bird.feathers if f.region == "scapular"]
    under = [np.argmin(np.linalg.norm(centres - place, axis=1)) for place in scapulars]
    assert normals[under, 2].min() > 0.3


def test_colours_pass_into_each_other_where_parts_do(bird):
    colours = {f.id: f.kind.colour.base for f in bird.feathers if f.region in TRACTS}
    whole = {part: Counter(c for id, c in colours.items() if id.startswith(f"{part}_"))
             for part in ("nape", "crown")}  # fmt: skip
    (nape, _), (crown, _) = (whole[part].most_common(1)[0] for part in ("nape", "crown"))
    assert (nape, crown) == ((0.18, 0.30, 0.30), (0.19, 0.23, 0.29))
    films = Counter(f.kind.colour.film for f in bird.feathers if f.region == "nape")
    assert films.most_common(1)[0][0] == 5.1e-7
    # towards parts that have a film its thickness is between both, towards others a feather has it
    # or not: thinner ones would have other colours
    assert 0.0 in films
    assert any(4.25e-7 < film < 5.1e-7 for film in films)
    assert all(film == 0.0 or 4.25e-7 <= film <= 5.1e-7 for film in films)
    between = pytest.approx(0.5 * (np.array(nape) + crown))
    places = {f.id: f.position for f in bird.feathers}
    mixed = [
        id for part in whole for id in colours if id.startswith(part) and colours[id] == between
    ]
    assert len(mixed) > 4
    length = np.mean([f.kind.length for f in bird.feathers if f.id.startswith("nape_")])
    reach = (0.35 + 1.0 / 3.0) * length  # the border, and from place to place where cover is 9
    for id in mixed:  # close to feathers of both
        for part in whole:
            own = [places[each] for each in colours if each.startswith(f"{part}_")]
            assert np.linalg.norm(np.array(own) - places[id], axis=1).min() < reach


def test_feathers_of_a_part_differ_in_width(bird):
    for part in TRACTS:
        widths = [f.kind.width / f.kind.length for f in bird.feathers if f.region == part]
        assert len(widths) < 40 or 0.03 < np.std(widths) < 0.05, part


def tip(feather):
    """(3,) m, the end of an arc."""
    turned = np.radians(feather.kind.rachis.camber)
    forward, down = np.sin(turned) / turned, (1.0 - np.cos(turned)) / turned
    way = forward * feather.rotation[:, 0] - down * feather.rotation[:, 2]
    return feather.position + feather.kind.length * way


def test_spread_wings_stand_at_their_landmarks(tmp_path):
    """Moved off the body as folded ones are, they left a gap to it."""
    kind = f'type = {{ base = "pigeon", {BARE} }}\nfold = 0'
    groom = read_groom(changed(tmp_path, r"^type.*", kind))
    at = {joint.name: joint.position for joint in groom.joints}
    assert at["right_wing_shoulder"] == pytest.approx((0.04, -0.042, 0.205))
    assert at["left_wing_shoulder"] == pytest.approx((0.04, 0.042, 0.205))


@pytest.mark.usefixtures("wings_as_typed")
def test_sizes_follow_the_body(bird, tmp_path):
    kind = f'type = {{ base = "pigeon", {BARE} }}\nscale = 2.0'
    double = read_groom(changed(tmp_path, r"^type.*", kind))
    sizes = [
        {f.id: f.kind.length for f in groom.feathers if f.turning is not None}
        for groom in (bird, double)
    ]
    ratio = {sizes[1][name] / sizes[0][name] for name in sizes[0]}
    distance = np.linalg.norm(np.array([0.166, 0, 0.272]) - [-0.134, 0, 0.138])
    assert min(ratio) == pytest.approx(max(ratio))
    assert max(ratio) == pytest.approx(2.0 * 0.26 / distance)


@pytest.mark.usefixtures("wings_as_typed")
def test_a_train_of_many_feathers_is_not_deeper_than_its_root_is_wide(tmp_path):
    kind = f'type = {{ base = "pigeon", tail.count = 150, tail.coverts = [], {BARE} }}'
    groom = read_groom(changed(tmp_path, r"^type.*", kind))
    roots = np.array([f.position for f in groom.feathers if f.id.startswith("tail_")])
    assert len(roots) == 150
    assert np.ptp(roots[:, 2]) < np.ptp(roots[:, 1])


@pytest.mark.usefixtures("wings_as_typed")
@pytest.mark.parametrize(("kind", "count", "most"), [("ostrich", 50, 25), ("peacock", 200, 0)])
def test_few_feathers_of_large_shut_tails_pass_through_each_other(tmp_path, kind, count, most):
    """Laid flat, without an arch, it is 513 and 270 pairs; of a train as one fan 60."""
    bare = f'type = {{ base = "{kind}", {BARE} }}'
    groom = read_groom(changed(tmp_path, r"^type.*", bare))
    tail = [f for f in groom.feathers if f.id.startswith("tail_")]
    assert len(tail) == count
    assert len(crossed(tail, 11, 4)) <= most


@pytest.mark.parametrize("clear", [0.02, 0.1])
def test_folded_wings_stay_off_the_body_as_far_as_their_type_says(bird, clear):
    body, shoulder = Body(bird.skin, np.eye(3), np.zeros(3)), np.array([0.04, -0.042, 0.205])
    kind = wing_type({"base": "pigeon"}, Place("", "", Problems()), Library((), Problems()))
    kind = replace(kind, body_clearance=clear, lift=0.0)
    body = replace(body, middle=np.array([-0.134, 0.0, 0.138]))
    kind, sheet, _ = drape.lie_on(kind, shoulder, 1.0, body, 0.0)
    bones = folded(kind, shoulder, np.array([0.045, 0.053, 0.058]), body.axes, False, 1.0)
    shafts = lying(kind, bones, 1.0, sheet)[:, 1:]
    gaps = np.sort(body.gaps(shafts.reshape(-1, 3)))
    assert np.percentile(gaps, drape._NEAREST) == pytest.approx(
        clear * max(kind.primaries.lengths), rel=0.15
    )


def test_folded_wings_that_open_have_room_for_their_under_coverts(bird, tmp_path):
    """As much as they lie farther below a bent sheet than below a flat wing."""
    body, room = Body(bird.skin, np.eye(3), np.zeros(3)), []
    row = 'name = "under", kind = "lesser_covert", side = "below", length = 0.2'
    for gap in (0.002, 0.02):
        rows = f"wing.bands = [], wing.coverts = [{{ {row}, chord_position = 0.5, gap = {gap} }}]"
        kind = f'type = {{ base = "pigeon", {rows}, {BARE} }}\nopens = true'
        groom = read_groom(changed(tmp_path, r"^type.*", kind))
        under = np.array([f.position for f in groom.feathers if "_wing_under_" in f.id])
        room.append(np.percentile(body.gaps(under), drape._NEAREST))
    assert room[1] - room[0] > (BENT_HEIGHT - 1.0) * (0.02 - 0.002)


def test_tips_of_folded_wings_are_as_far_apart_as_their_type_says(bird):
    body = Body(bird.skin, np.eye(3), np.array([-0.134, 0.0, 0.138]))
    kind = wing_type({"base": "pigeon"}, Place("", "", Problems()), Library((), Problems()))
    longest, lengths = max(kind.primaries.lengths), np.array([0.045, 0.053, 0.058])
    for gap in (0.0, 0.06):
        shoulder = np.array([0.04, -0.042, 0.205])
        own, sheet, _ = drape.lie_on(replace(kind, tip_gap=gap), shoulder, 1.0, body, 0.0)
        bones = folded(own, shoulder, lengths, body.axes, False, 1.0)
        shafts = lying(own, bones, 1.0, sheet)[:, 1:]
        farthest = np.argmax(np.linalg.norm(shafts[:, -1] - shafts[:, 0], axis=1))
        assert -shafts[farthest, -1, 1] == pytest.approx(gap * longest, abs=0.02 * longest)


@pytest.mark.nightly
def test_what_folded_wings_miss_of_their_type_is_told_once(tmp_path):
    kind = f'type = {{ base = "pigeon", wing.base = "pigeon", wing.back_gap = 1, {BARE} }}'
    with pytest.warns(InputWarning, match=r"back_gap = -?0\.\d\d, not 1, .* Give these") as told:
        read_groom(changed(tmp_path, r"^type.*", kind))
    assert len(told) == 1


@pytest.mark.usefixtures("wings_as_typed")
@pytest.mark.parametrize("space", ["", '[space]\nof = "skin"\nleft = "x"\n'])
def test_a_body_with_y_up_in_centimetres_gets_the_same_bird(tmp_path, space):
    """With landmarks by points of the mesh, which are the same in any space."""
    stage = Usd.Stage.Open(str(BIRD / "body.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/pigeon/body"))
    points = np.array(mesh.GetPointsAttr().Get())
    marked = re.sub(
        r"^(\w+) = (\[[-\d., ]+\])$",
        lambda m: f"{m[1]} = {{ vertex = {nearest(points, m[2])} }}",
        TEXT,
        flags=re.M,
    )
    assert marked.count("vertex") == 10
    kind = f'type = {{ base = "pigeon", {scarce(0, "nape")} }}'
    marked = re.sub(r"^bare.*\n", "", re.sub("^type.*", kind, marked, flags=re.M), flags=re.M)
    own, other = tmp_path / "own", tmp_path / "other"
    for folder, table in ((own, ""), (other, space)):
        folder.mkdir()
        (folder / "groom.toml").write_text(f"{marked}\n{table}")
        stage.GetRootLayer().Export(str(folder / "body.usdc"))
    turned = Usd.Stage.Open(str(other / "body.usdc"))
    UsdGeom.SetStageUpAxis(turned, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(turned, 0.01)
    body = UsdGeom.Mesh(turned.GetPrimAtPath("/pigeon/body"))
    body.GetPointsAttr().Set(100.0 * points[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0], np.float32))
    UsdGeom.Xformable(turned.GetPrimAtPath("/pigeon")).AddRotateYOp().Set(-90.0)
    turned.Save()
    first, second = (read_groom(folder / "groom.toml").feathers for folder in (own, other))
    assert [each.id for each in first] == [each.id for each in second]
    # the groom's x is the stage's, which is the body's left
    way = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for one, two in zip(first, second, strict=True):
        assert two.position == pytest.approx(way @ one.position, abs=1e-5)
    off = [np.abs(b.rotation - way @ a.rotation).max() for a, b in zip(first, second, strict=True)]
    # a skin of triangles leaves it open by rounding which of two is nearest to a place
    assert np.quantile(off, 0.6) < 1e-3
    assert max(off) < 0.5


def nearest(points, place):
    """Number of the point of a mesh that is nearest to a place, typed in metres."""
    return int(np.linalg.norm(points - np.array(json.loads(place)), axis=1).argmin())


@pytest.mark.usefixtures("wings_as_typed")
@pytest.mark.nightly
def test_an_owl_has_a_disc_that_points_away_from_its_eyes(tmp_path):
    kind = f'type = {{ base = "owl", disc.radius = 0.014, disc.length = 0.005, {scarce(0.3)} }}'
    path = changed(tmp_path, "^type.*", kind)
    before = {feather.region for feather in read_groom(path).feathers}
    eyes = {"right": np.array([0.128, -0.018, 0.289]), "left": np.array([0.128, 0.018, 0.289])}
    named = "".join(f"{side}_eye = {place.tolist()}\n" for side, place in eyes.items())
    path.write_text(path.read_text() + named)
    found = read_groom(path).feathers
    own = {"right_disc", "left_disc", "right_rim", "left_rim"}
    assert {feather.region for feather in found} - before == own
    for feather in found:
        away = {side: feather.position - place for side, place in eyes.items()}
        side, _, part = feather.region.partition("_")
        if feather.region in own:
            assert away[side] @ feather.rotation[:, 0] > 0.0
            far = np.linalg.norm(away[side])
            assert far < np.linalg.norm(away["left" if side == "right" else "right"])
            assert far < 0.02 if part == "disc" else 0.01 < far < 0.03
        elif feather.region in TRACTS:
            assert min(np.linalg.norm(each) for each in away.values()) > 0.012


@pytest.mark.usefixtures("wings_as_typed")
@pytest.mark.nightly
def test_a_cheek_is_below_and_behind_the_eyes_and_feathers_begin_where_the_bill_ends(tmp_path):
    own = 'tracts.cheek = { kind = "contour", length = 0.006 }'
    kind = f'type = {{ base = "pigeon", {own}, {scarce(3)}, bill = BILL }}'
    eyes = "right_eye = [0.128, -0.018, 0.289]\nleft_eye = [0.128, 0.018, 0.289]\n"

    def grown(bill, eyes=eyes):
        path = changed(tmp_path, "^type.*", kind.replace("BILL", str(bill)))
        path.write_text(path.read_text() + eyes)
        return read_groom(path).feathers

    found = grown(0.3)
    cheeks = np.array([f.position for f in found if f.region == "cheek"])
    assert len(cheeks) > 10
    assert cheeks[:, 2].mean() < 0.28  # m, the eyes 9 mm higher
    assert cheeks[:, 0].mean() < 0.128
    assert 0.3 < (cheeks[:, 1] > 0.0).mean() < 0.7
    assert "cheek" not in {f.region for f in grown(0.3, "")}
    front = [max(f.position[0] for f in each if f.region == "face") for each in (found, grown(0.8))]
    assert front[1] < front[0] - 0.005


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (r"^crown.*\n", "", "bird.landmarks.crown: missing"),
        (r"^tail = .*", "tail = [0.166, 0, 0.272]", "tail: is at the place of beak"),
        ("_shoulder = .*0.042", "_shoulder = [0.04, 0.042", "is at the place of"),
        (
            "^right_heel",
            "right_wing = [[0, -1, 0], [1, -1, 0], [0, -2, 0]]\nright_heel",
            "left_wing",
        ),
        ("^left_heel.*", "", "landmarks.left_heel: missing, right_heel is there"),
        (
            "^beak = .*",
            "beak = [1.66, 0, 0.272]",
            "landmarks.beak: is 1.49 m off the skin, whose box has a diagonal of",
        ),
        (r"\[skin\]\nusd.*\nprim.*", "", "bird: stands without [skin]"),
        (
            r'^type = "pigeon"',
            'type = "pigeons"',
            "no bird preset 'pigeons', did you mean 'pigeon'",
        ),
        (r"^bare", "fold = 1.5\nbare", "fold: 1.5 is out of range"),
        (
            r'^type = "pigeon"',
            MANY_QUILLS,
            "bird.type.wing.primaries.count: 90 feathers with quills",
        ),
        (
            "^nape = .*",
            "nape = [0.094, 0, 2.9]",
            "nape: is 2.63 m from beak and tail, which are 0.3",
        ),
        (r"^tail = .*\n", "", "bird.landmarks.tail: missing, expects an array of 3 numbers"),
        (
            "^right_heel",
            "middle_wing = [[0, -1, 0], [1, -1, 0], [0, -2, 0]]\nright_heel",
            "bird.landmarks.middle_wing: unknown key",
        ),
        (
            r'^type = "pigeon"',
            f'type = {{ base = "pigeon", wing.base = "pigeon", {NO_QUILLS} }}',
            "bird.type.wing.primaries.count: 0, and secondaries and tertials have none either",
        ),
        (
            r'^type = "pigeon"',
            'type = { base = "pigeon", tracts.breast.relative_density = 10000000 }',
            "bird.type.tracts.breast.relative_density: 10000000 is out of range. Give 0 to 100",
        ),
        ('^prim = "/pigeon/body"', 'prim = "/pigeon/bdy"', "skin.prim: no prim /pigeon/bdy in "),
    ],
)
@pytest.mark.usefixtures("wings_as_typed")
def test_faults_of_a_bird_are_told(tmp_path, old, new, message):
    with pytest.raises(InputError) as caught:
        read_groom(changed(tmp_path, old, new))
    assert len(caught.value.problems) == 1
    assert message in str(caught.value.problems[0])


@pytest.mark.usefixtures("wings_as_typed")
def test_a_third_wing_and_a_species_that_extends_itself_are_told(tmp_path):
    path = changed(tmp_path, r'^type = "pigeon"', 'type = "loop"')
    (tmp_path / "bird").mkdir()
    (tmp_path / "bird/loop.toml").write_text('base = "loop"\n')
    with pytest.raises(InputError, match="base: preset cycle: loop -> loop"):
        read_groom_file(path, [tmp_path], scene_readers())
    third = 'id = "right_wing"\ntype = "pigeon"\nfold = 1\nside = "right"\nshoulder = [0, 0, 0.2]\n'
    bald = changed(tmp_path, r'^type = "pigeon"', f'type = {{ base = "pigeon", {BARE} }}')
    bald.write_text(f"{bald.read_text()}\n[[wing]]\n{third}")
    with pytest.raises(InputError) as caught:
        read_groom(bald)
    (problem,) = caught.value.problems
    assert str(problem).endswith("wing[0].id: 'right_wing' is taken by bird. Choose another")


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ("right_shoulder", "left_shoulder", "is to the right of right_shoulder: are the two"),
        ("breast", "vent", "is behind vent: are the two exchanged?"),
        ("beak", "nape", "is behind nape"),
        ("crown", "nape", "crown: is behind nape"),
        ("vent", "tail", "vent: is behind tail"),
        ("nape", "breast", "nape: is below breast"),
        ("left_heel", "right_heel", "left_heel: is to the right of right_heel"),
        ("beak", "tail", "beak: is behind tail"),
    ],
)
def test_exchanged_landmarks_are_told(tmp_path, first, second, message):
    path = changed(tmp_path, f"^{first} =", "held =")
    text = re.sub(f"^{second} =", f"{first} =", path.read_text(), flags=re.M)
    path.write_text(re.sub("^held =", f"{second} =", text, flags=re.M))
    with pytest.raises(InputError, match=re.escape(message)):
        read_groom(path)


def test_a_neck_may_be_stretched_out():
    """As that of a swan in flight, whose nape is as low as its breast."""
    points = {
        "beak": (1.02, 0, 0.50),
        "crown": (0.85, 0, 0.61),
        "nape": (0.81, 0, 0.58),
        "breast": (0.29, 0, 0.48),
        "right_shoulder": (0.10, -0.13, 0.53),
        "left_shoulder": (0.10, 0.13, 0.53),
        "vent": (-0.20, 0, 0.30),
        "tail": (-0.35, 0, 0.36),
    }
    given = {name: np.array(place, dtype=float) for name, place in points.items()}
    axes = axes_of(given, (0.0, 0.0, 1.0), Place("bird", "", Problems()))
    np.testing.assert_allclose(axes[:, 1], (0.0, 1.0, 0.0), atol=1e-12)


def test_birds_and_wings_are_listed():
    families = Counter(each.family for each in list_presets())
    assert families["bird"] >= 8
    assert families["wing"] >= 8


def test_a_bird_has_the_colours_of_its_preset_below_the_overrides(bird, tmp_path):
    shades = {feather.region: feather.kind.colour for feather in bird.feathers}
    assert shades["foreneck"].base != shades["belly"].base
    assert [mark.kind for mark in shades["secondaries"].patterns] == ["bars"]
    # a preset may name what a bird has not: another's crest
    crest = 'type = { base = "pigeon", colours = { "crest*" = { base = [1, 1, 1] } } }'
    path = changed(tmp_path, '^type = "pigeon"', crest)
    red = "overrides = { 'belly*' = { colour.base = [1, 0, 0] } }\n"
    path.write_text(red + path.read_text())
    found = {feather.region: feather.kind.colour for feather in read_groom(path).feathers}
    assert found.pop("belly").base == (1.0, 0.0, 0.0)
    assert found == {region: shade for region, shade in shades.items() if region != "belly"}


@pytest.mark.usefixtures("wings_as_typed")
@pytest.mark.nightly
def test_a_crest_grows_from_the_skin_not_within_the_skull(tmp_path):
    bird = read_groom(changed(tmp_path, '"pigeon"', '"parrot"'))
    body = Body(bird.skin, np.eye(3), np.zeros(3))
    gaps = body.gaps(np.array([f.position for f in bird.feathers if f.region == "crest"]))
    # between triangles of 4 mm; its line from landmark to landmark is 10 mm deep in the skull
    assert gaps.min() > -3e-4
    assert gaps.max() < 2e-3


@pytest.mark.usefixtures("wings_as_typed")
def test_a_mantle_begins_where_the_neck_of_its_type_ends(tmp_path):
    """The ostrich's reached up the back of its neck."""
    bare, highest = scarce(0, "nape", "mantle"), []
    for neck in (0.5, 1.0):
        kind = f'type = {{ base = "pigeon", {bare}, tail.count = 0, neck = {neck} }}'
        groom = read_groom(changed(tmp_path, "^type.*", kind))
        mantle = [f.position[2] for f in groom.feathers if f.region == "mantle"]
        highest.append(np.quantile(mantle, 0.9))
    assert highest[0] > highest[1] + 4e-3, highest
