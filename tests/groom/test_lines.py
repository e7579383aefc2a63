"""Shafts and barbs drawn as lines: followed within 1 % of their lengths, or told why not."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import at_origin

from featherfx.feather.build import build_feather
from featherfx.groom.read.read import read_groom
from featherfx.mechanics.batch import make_model
from featherfx.shot.read.read import check_file

SHARES = np.linspace(0.0, 1.0, 41)


def wave(inflections, size, up=False):
    """A wave of that many inflections within the vane's plane, or out of it."""
    bent = size * np.sin((inflections + 1) * np.pi * SHARES)
    return np.stack([SHARES, *((0.0 * SHARES, bent) if up else (bent,))], axis=1)


def screw():
    return np.stack([SHARES, 0.03 * np.cos(9.0 * SHARES), 0.03 * np.sin(9.0 * SHARES)], axis=1)


def read(tmp_path, text, base="primary"):
    """The kind of a groom's one feather with some overrides."""
    file = tmp_path / "groom.toml"
    feather = f'[[feather]]\nid = "a"\nkind = "{base}"\nposition = [0, 0, 0]\n'
    file.write_text(
        f'name = "g"\n{feather}direction = [1, 0, 0]\nup = [0, 0, 1]\n[overrides.a]\n{text}\n'
    )
    return read_groom(file).feathers[0].kind


def apart(kind, drawn):
    """Largest distance of drawn points from the built shaft, laid upon them with roots together,
    in lengths of the line."""
    shaft = build_feather(kind, 400, 1).rest.nodes[:, 0] / kind.length
    lifted = np.zeros((len(drawn), 3))
    lifted[:, : drawn.shape[1]] = drawn - drawn[0]
    lifted /= np.linalg.norm(np.diff(lifted, axis=0), axis=1).sum()
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(lifted, axis=0), axis=1))])
    own = np.stack(
        [np.interp(along, np.linspace(0.0, 1.0, len(shaft)), each) for each in shaft.T], axis=1
    )
    left, _, right = np.linalg.svd(own.T @ lifted)
    keeps = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return float(np.linalg.norm(own @ left @ keeps @ right - lifted, axis=1).max())


@pytest.mark.parametrize(
    ("base", "line"),
    [
        ("primary", wave(1, 0.03)),
        ("tail_feather", wave(3, 0.03)),
        ("covert", wave(5, 0.01)),
        ("primary", wave(5, 0.02, up=True)),
        ("peacock_tail", screw()),
        ("down", wave(0, 0.05)),
    ],
)
def test_a_line_is_followed_within_a_hundredth(tmp_path, base, line):
    kind = read(tmp_path, f"rachis.line = {(100.0 * line).round(4).tolist()}", base)
    assert apart(kind, line) < 0.01


def test_a_line_is_followed_as_it_lies_to_the_leading_side_and_dorsal(tmp_path):
    kind = read(tmp_path, "rachis.line = [[0, 0, 0], [3, 0, 0], [6, 1, 0.5]]")
    tip = build_feather(kind, 21, 1).rest.nodes[-1, 0] / kind.length
    assert tip[1] == pytest.approx(0.16, abs=0.02)
    assert tip[2] == pytest.approx(0.08, abs=0.02)


def test_a_line_stands_for_camber_and_sweep_and_leaves_twist_and_length(tmp_path):
    straight = "rachis.line = [[0, 0], [2, 0]]"
    kind = read(tmp_path, f"rachis.camber = 40\nrachis.twist = 30\n{straight}")
    shape = kind.rachis
    assert (shape.camber, shape.sweep, shape.course, shape.twist) == (0.0, 0.0, (), 30.0)
    assert kind.length == read(tmp_path, "").length
    assert read(tmp_path, f"{straight}\nrachis.camber = 40", "covert").rachis.camber == 0.0
    without = read(tmp_path, "rachis.line = []\nrachis.camber = 40")
    assert without.rachis.camber == 40.0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("[[0, 0]]", "line: has 1 point. Give 2 to 200 (or none)"),
        ("[[0, 0], [1]]", "line[1]: has 1 item. Give 2 to 3"),
        ("[[0, 0], [nan, 1]]", "line[1][0]: nan is not a finite number"),
        ("[[0, 0], [1, 0, 0], [1, 0]]", "line[2]: is the point before it once more"),
        ("[[0, 0], [2, 0], [1, 1], [1, -1]]", "line[2]: the line crosses itself: segments 0 and 2"),
        ("[[0, 0, 0], [0, 0, 2], [1, 0, 3]]", "line: leaves the follicle square to the vane"),
        (
            str(wave(9, 0.03).tolist()),
            "times as sharply within the vane, at 0.65 of its length, as lets barbs lie side by",
        ),
    ],
)
def test_lines_that_no_shaft_follows(tmp_path, line, message):
    path = tmp_path / "feather/bad.toml"
    path.parent.mkdir()
    path.write_text(f'base = "primary"\nrachis.line = {line}\n')
    (found,) = map(str, check_file(path))
    assert f"{path}: rachis.{'line' if message.startswith('times') else message[:4]}" in found
    assert message in found


FLAT = "rachis.line = [[0, 0], [1, 0]]\nrachis.twist = 0\ncalamus = 0\n"
BAND = "outline = [[0, 0.1], [0.5, 0.1], [1, 0.1]]\nrounded_base = 0\nrounded_tip = 0\n"
# twice bent, once to either side
BARB = np.array([[0.0, 0.0], [0.45, 0.6], [1.0, 1.0], [1.2, 1.6], [1.7, 2.1], [2.4, 2.4]])
LINE = f"line = {BARB.tolist()}"
ONE = f"guides = [{{ position = 0, {LINE} }}]"


def flat(tmp_path, *guides):
    """A kind with vanes of even width on a straight shaft."""
    sides = (f"[overrides.a.{side}]\n{BAND}{guides[0]}\n" for side in ("leading", "trailing"))
    return read(tmp_path, FLAT + "".join(sides))


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("columns", [6, 40])
def test_barbs_are_as_their_guide_is_drawn(tmp_path, side, columns):
    feather = build_feather(flat(tmp_path, ONE), 21, columns)
    row, first = 8, 1 + side * columns
    nodes = feather.rest.nodes[row, [0, *range(first, first + columns)]]
    # out to the outline, as all that end there are alike
    assert abs(nodes[-1, 1]) == pytest.approx(0.1 * feather.station[-1], rel=1e-3)
    assert abs(nodes[:, 2]).max() < 1e-12
    own = (nodes - nodes[0])[:, :2] * [1.0, 1.0 - 2.0 * side] / abs(nodes[-1, 1])
    drawn = BARB / BARB[-1, 1]
    length = np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum()
    fine = np.linspace(0, len(own) - 1, 2001)
    line = np.stack([np.interp(fine, np.arange(len(own)), each) for each in own.T], axis=1)
    near = np.linalg.norm(line[:, None] - drawn, axis=2).min(axis=0)
    assert near.max() < (0.01 if columns == 40 else 0.03) * length


def test_barbs_that_are_drawn_have_even_segments_and_rest_as_they_are(tmp_path):
    curved = f"guides = [{{ position = 0, {LINE}, camber = 20 }}]"
    kind = flat(tmp_path, curved)
    feather = build_feather(kind, 15, 7)
    barbs = np.concatenate([feather.rest.nodes[:, :1], feather.rest.nodes[:, 1:8]], axis=1)
    segments = np.linalg.norm(np.diff(barbs, axis=1), axis=2)
    assert np.abs(segments - feather.barb_length[0][:, None] / 7).max() < 1e-15
    rest = at_origin(make_model([feather], [kind], 3)).points.nodes[0]
    assert np.abs(rest - feather.rest.nodes).max() < 1e-12


def test_a_course_of_nothing_is_an_arc(tmp_path):
    arc = "{ position = 0, angle = 50, curl = 30, camber = 10"
    kinds = [flat(tmp_path, f"guides = [{arc}{more} }}]") for more in NOTHING]
    nodes = [build_feather(kind, 21, 6).rest.nodes for kind in kinds]
    assert np.abs(nodes[1] - nodes[0]).max() < 1e-5 * kinds[0].length


NOTHING = "", ", course = [[0, 0, 0], [1, 0, 0]]"


def test_barbs_between_guides_are_between_them(tmp_path):
    """From a barb that is drawn to a straight one."""
    straight = "{ position = 1, angle = 45 }"
    kind = flat(tmp_path, f"guides = [{{ position = 0, {LINE} }}, {straight}]")
    nodes = build_feather(kind, 41, 12).rest.nodes
    barbs = np.concatenate([nodes[:, :1], nodes[:, 1:13]], axis=1)[:, :, :2]
    chords = barbs[:, -1] - barbs[:, 0]
    away = barbs - barbs[:, :1]
    side = away[..., 0] * chords[:, None, 1] - away[..., 1] * chords[:, None, 0]
    bulge = np.abs(side).max(axis=1)[:36] / np.maximum((chords**2).sum(axis=1)[:36], 1e-12)
    assert bulge[0] > 0.05
    assert (np.diff(bulge) < 1e-9).all()


@pytest.mark.parametrize(
    ("guide", "message"),
    [
        ("position = 0", "[0].angle: missing, expects a number, 5 to 120 deg, or a line"),
        ("position = 0, line = [[0, 0]]", "[0].line: has 1 point. Give 2 to 200 (or none)"),
        (
            "position = 0, line = [[0, 0], [2, 0], [1, 1], [1, -1]]",
            "[0].line[2]: the line crosses itself: segments 0 and 2 meet",
        ),
        ("position = 0, line = [[0, 0], [-3, 1]]", "[0].line: leaves the shaft at 162 deg"),
        ("position = 0, line = [[0, 0], [1, inf]]", "[0].line[1][1]: inf is not a finite number"),
        (
            "position = 0, angle = 40, course = [[0.5, 0, 0], [0.5, 9, 0]]",
            "[0].course[1][0]: 0.5 is not above the point before it (0.5). Points ascend",
        ),
    ],
)
def test_guides_that_cannot_be_followed(tmp_path, guide, message):
    path = tmp_path / "feather/bad.toml"
    path.parent.mkdir()
    path.write_text(f'base = "primary"\ntrailing.guides = [{{ {guide} }}]\n')
    (found,) = map(str, check_file(path))
    assert found.startswith(f"{path}: trailing.guides{message}")
