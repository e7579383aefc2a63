"""Shafts that a preset draws as lines: followed within 1 % of the length, or told why not."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.feather.build import build_feather
from featherfx.groom.read.read import read_groom
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
        ("[[0, 0]]", "line: has 1 point, allowed 2 to 200 (or none)"),
        ("[[0, 0], [1]]", "line[1]: has 1 items, allowed 2 to 3"),
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
