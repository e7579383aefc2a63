"""Shot files, the samples, and the generated reference."""

from __future__ import annotations

import subprocess
import sys
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

from featherfx.errors import InputError
from featherfx.shot.read.read import check_file, read_shot
from featherfx.shot.read.reference import reference

GROOM = """
name = "groom"
[[joint]]
name = "hip"
position = [0, 0, 0]
[[feather]]
id = "tail"
kind = "tail_feather"
position = [0, 0, 0]
"""
SHOT = """
name = "shot"
groom = "groom.toml"
frames = [1, 5]
"""
KEYS = (
    '{{ kind = "keys", keyframes = [{{ time = {}, position = [0, 0, 0] }},'
    " {{ time = {}, rotation = [0, 0, 0] }}] }}"
)


def write(folder: Path, shot: str = SHOT, groom: str = GROOM) -> Path:
    (folder / "groom.toml").write_text(groom, encoding="utf-8")
    path = folder / "shot.toml"
    path.write_text(shot, encoding="utf-8")
    return path


def found(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_shot(path)
    assert list(caught.value.problems) == check_file(path)
    return [str(each).replace(f"{path.parent}/", "") for each in caught.value.problems]


def test_defaults(tmp_path: Path) -> None:
    shot = read_shot(write(tmp_path))
    assert (shot.first_frame, shot.last_frame, shot.frames_per_second) == (1, 5, 24.0)
    assert (shot.motion.kind, shot.wind.speed, shot.quality.name) == ("hold", 0.0, "preview")
    np.testing.assert_array_equal(shot.gravity, (0, 0, -9.81))
    assert shot.settle
    assert shot.groom.source == tmp_path / "groom.toml"


def test_presets_with_changes(tmp_path: Path) -> None:
    text = SHOT + 'quality = "draft"\n[wind]\nbase = "storm"\nspeed = 12\ndirection = [0, 3, 4]\n'
    text += '[motion]\nbase = "flap"\nwingbeat_frequency = 2\n'
    shot = read_shot(write(tmp_path, text))
    assert (shot.wind.speed, shot.wind.gust) == (12.0, 0.4)
    np.testing.assert_allclose(shot.wind.direction, (0, 0.6, 0.8))
    assert (shot.motion.kind, shot.motion.values["wingbeat_frequency"]) == ("flap", 2.0)
    assert shot.motion.values["stroke_amplitude"] == 70.0
    assert "kind" not in shot.motion.values
    assert (shot.quality.rows, shot.quality.columns, shot.quality.error) == (11, 4, 3.0)


def test_keyframes(tmp_path: Path) -> None:
    text = (
        SHOT
        + """
[motion]
kind = "keys"
[[motion.keyframes]]
time = 0
joint = "hip"
rotation = [0, 0, 30]
[[motion.keyframes]]
time = 1
position = [0, 0, 1]
rotation = [1, 0, 0, 0]
"""
    )
    first, second = read_shot(write(tmp_path, text)).motion.values["keyframes"]
    assert (first["joint"], first["rotation"], first["position"]) == ("hip", (0, 0, 30), None)
    assert (second["joint"], second["position"]) == ("", (0, 0, 1))


def test_problems_of_shot_groom_and_presets_come_together(tmp_path: Path) -> None:
    shot = (
        SHOT.replace("[1, 5]", "[5, 1]")
        + """
quality = "drft"
gravity = [0, 0]
[wind]
sped = 3
[motion]
kind = "keys"
[[motion.keyframes]]
time = 0
joint = "hop"
rotation = [0, 0, 0, 0]
[[motion.keyframes]]
time = 1
[[grip]]
feather = "tail"
displacement = [0, 0.1, 0]
start = 1
end = 1
stiffness = 100
"""
    )
    problems = found(write(tmp_path, shot, GROOM.replace("tail_feather", "tail_fether")))
    assert problems == [
        "shot.toml: gravity: has 2 items. Give 3 numbers",
        "shot.toml: wind.sped: unknown key, did you mean 'speed'?",
        "groom.toml: feather[0].kind: no feather preset 'tail_fether', did you mean "
        "'tail_feather'?",
        "shot.toml: quality: no quality preset 'drft', did you mean 'draft'?",
        "shot.toml: motion.keyframes[0].rotation: the quaternion is zero. Give one with a length",
        "shot.toml: motion.keyframes[1]: holds neither position nor rotation. Give one of them",
        "shot.toml: grip[0].end: 1 is not later than start = 1 s",
        "shot.toml: frames: the last frame 1 comes before the first 5",
    ]


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("position = [0, 0, 0], tangents = [1, 0, 0]", "keyframes[1].tangents: are rates of one"),
        ('rotation = [0, 9, 0], order = "zyx"', "keyframes[1].order: is 'zyx' after 'xyz' of the"),
        ('rotation = [0, 9, 0], tangents = "auto"', "keyframes[1].tangents: 'auto' is not allowed"),
        ("rotation = [0, 1e6, 0]", "keyframes[1].rotation[1]: 1e+06 is out of range. Give -36000"),
        ("rotation = [1, 0, 0, 0]", "keyframes[0].rotation: counts turns beside angles only"),
        (
            "time = 0, rotation = [0, 9, 0]",
            "keyframes[1].time: 0 s has a rotation of this joint already. Give",
        ),
        (
            "time = -1, rotation = [0, 9, 0]",
            "keyframes[1].time: -1 s comes after 0 s of this joint",
        ),
        ("time = -1e6, rotation = [0, 9, 0]", "keyframes[1].time: -1e+06 is out of range. Give"),
    ],
)
def test_faults_of_keyframes(tmp_path: Path, second: str, said: str) -> None:
    second = second if "time" in second else f"time = 1, {second}"
    second = second if "rotation" in second else f"{second}, rotation = [0, 0, 0]"
    first = [0, 0, 0] if "[1, 0, 0, 0]" not in second else [0, 270, 0]
    keys = f"[{{ time = 0, rotation = {first} }}, {{ {second} }}]"
    shot = f'{SHOT}\n[motion]\nkind = "keys"\nkeyframes = {keys}\n'
    (problem,) = found(write(tmp_path, shot))
    assert problem.startswith(f"shot.toml: motion.{said}")


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ('{ base = "shake", frequency = 12.5 }', "motion.frequency: 12.5 shakes a second look slo"),
        (f"{KEYS.format(0, 1.2)}", "motion: goes on until frame 34, and the shot ends with frame"),
        (f"{KEYS.format(-2, -1)}", "motion: is over at frame -19, before the first, 5. Give later"),
        (
            '{ base = "flap", beats = 2, start = 0.5 }',
            "motion: goes on until frame 113, and the shot ends with frame 5. Give frames = [5, 1",
        ),
        ('{ base = "shake", frequency = 12 }', ""),
        (
            KEYS.format(-2, -2),
            "motion: has keyframes at one time alone, so that nothing moves. Give",
        ),
        (KEYS.format(0, 0.04), ""),
        ('"flap"', ""),
    ],
)
def test_motions_that_frames_do_not_show_are_told(tmp_path: Path, motion: str, said: str) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read_shot(write(tmp_path, f"{SHOT.replace('[1, 5]', '[5, 5]')}motion = {motion}\n"))
    assert [str(each.message).partition("shot.toml: ")[2][: len(said)] for each in told] == (
        [said] if said else []
    )


def test_names_of_the_groom_are_checked_where_the_groom_is_sound(tmp_path: Path) -> None:
    shot = (
        SHOT
        + """
[motion]
kind = "keys"
keyframes = [{ time = 0, joint = "hop", position = [0, 0, 0] }]
[[grip]]
feather = "tial"
displacement = [0, 0.1, 0]
end = 1
stiffness = 100
"""
    )
    assert found(write(tmp_path, shot)) == [
        "shot.toml: motion.keyframes[0].joint: no joint 'hop' in the groom, did you mean 'hip'?",
        "shot.toml: grip[0].feather: no feather 'tial' in the groom, did you mean 'tail'?",
    ]


def test_missing_groom_is_named(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "groom.toml").unlink()
    assert found(path) == ["groom.toml: there is no such file. Check the path"]


def test_check_file_tells_shots_grooms_and_presets_apart(tmp_path: Path) -> None:
    path = write(tmp_path, SHOT + "wnd = 1\n", GROOM + "colour = 1\n")
    preset = tmp_path / "loose.toml"
    preset.write_text("speed = -1\ngust = 0.1\n")
    assert {each.key for each in check_file(path)} == {"wnd", "feather[0].colour"}
    assert {each.key for each in check_file(tmp_path / "groom.toml")} == {"feather[0].colour"}
    assert {each.key for each in check_file(preset)} == {"speed"}


@pytest.mark.parametrize("name", ["swan_wing", "feather_pull", "breeze"])
def test_samples_are_sound(name: str) -> None:
    for file in ("shot.toml", "groom.toml"):
        assert check_file(ROOT / "samples" / name / file) == []


def test_swan_wing_is_a_symmetric_bird_of_plausible_span() -> None:
    shot = read_shot(ROOT / "samples/swan_wing/shot.toml")
    assert len(shot.groom.feathers) == 20
    assert (shot.first_frame, shot.last_frame, shot.frames_per_second) == (1, 24, 24)
    tips = np.array([f.position + f.kind.length * f.rotation[:, 0] for f in shot.groom.feathers])
    assert 1.8 < np.ptp(tips[:, 1]) < 2.6  # a mute swan spans 2.0 to 2.4 m
    assert [f.mirrored for f in shot.groom.feathers].count(True) == 10
    assert all(f.mirrored == (f.position[1] > 0) for f in shot.groom.feathers)
    for feather in shot.groom.feathers:
        outwards = np.sign(feather.position[1])
        leading = feather.rotation[:, 1] * (-1 if feather.mirrored else 1)
        assert leading @ (1, outwards, 0) > 0  # leading vanes face forward and outward


def test_swan_wing_feathers_overlap_their_neighbours() -> None:
    feathers = read_shot(ROOT / "samples/swan_wing/shot.toml").groom.feathers
    for first, second in pairwise(feathers):
        if first.region != second.region or first.mirrored != second.mirrored:
            continue
        middle = [f.position + 0.5 * f.kind.length * f.rotation[:, 0] for f in (first, second)]
        wide = first.kind.length * max(y for _, y in first.kind.leading.outline)
        wide += second.kind.length * max(y for _, y in second.kind.trailing.outline)
        assert np.linalg.norm(middle[1] - middle[0]) < 0.95 * wide


def test_feather_pull_is_the_published_experiment() -> None:
    shot = read_shot(ROOT / "samples/feather_pull/shot.toml")
    feather, grip = shot.groom.feathers[0], shot.grips[0]
    assert feather.kind.length == pytest.approx(0.2, rel=1e-3)
    assert np.linalg.norm(grip.displacement) == pytest.approx(0.06, rel=1e-3)
    assert grip.displacement[2] == 0.0  # within the plane of the vane
    assert grip.end == (shot.last_frame - shot.first_frame) / shot.frames_per_second


def test_reference_page_is_up_to_date() -> None:
    text = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    assert text == reference(), "run: python -m featherfx.shot.read.reference > docs/reference.md"


def test_reading_loads_no_heavy_module() -> None:
    code = (
        "import sys, featherfx.shot.read.read, featherfx.groom.presets.presets\n"
        "assert not {'numba', 'pxr', 'scipy', 'trimesh', 'pyvista'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
