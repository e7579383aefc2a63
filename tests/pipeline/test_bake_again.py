"""After a change only the feathers that it touches are simulated again, to the same bytes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from commands import invoke
from places import COARSE

import featherfx
from featherfx.errors import InputError

GROOM = """
name = "two rows"

[[row]]
id = "upper"
kind = "swan_secondary"
count = 3
first = { position = [0.0, 0.0, 0.06], direction = [-1.0, 0.0, 0.0], up = [0, 0, 1] }
last = { position = [0.0, -0.1, 0.06], direction = [-1.0, 0.1, 0.0], up = [0, 0, 1] }
width = 1.5
region = "arm"

[[row]]
id = "lower"
kind = "swan_primary"
count = 2
first = { position = [0.0, 0.0, 0.0], direction = [-1.0, 0.0, 0.0], up = [0, 0, 1] }
last = { position = [0.0, -0.1, 0.0], direction = [-1.0, 0.1, 0.0], up = [0, 0, 1] }
width = 1.5
region = "hand"
"""
SHOT = (
    COARSE
    + """
name = "gust"
groom = "groom.toml"
frames = [1, 8]

[wind]
base = "breeze"
speed = 6.0

[[shelter]]                     # which would make each depend on those around
share = 0
"""
)
OPTIONS = {"frames": (1, 5), "chunk": 2}


def written(folder: Path, groom: str = GROOM, shot: str = SHOT) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "groom.toml").write_text(groom)
    (folder / "shot.toml").write_text(shot)
    return folder / "shot.toml"


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a finished cache of every layout."""
    folder = tmp_path_factory.mktemp("earlier")
    shot = written(folder)
    for layout in ("flat", "payload", "clips"):
        (folder / layout).mkdir()
        featherfx.bake(shot, folder / layout / "gust.usdc", layout=layout, **OPTIONS)
    return folder


def copied(earlier: Path, layout: str, target: Path) -> Path:
    shutil.copytree(earlier / layout, target / layout)
    return target / layout / "gust.usdc"


def content(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*.usd*")}


def changed_and_fresh(earlier, tmp_path, groom=GROOM, shot=SHOT, layout="flat", **options):
    """The report of a bake that goes on from the earlier cache; its bytes are a fresh one's."""
    path = copied(earlier, layout, tmp_path)
    file, options = written(tmp_path, groom, shot), OPTIONS | {"layout": layout} | options
    report = featherfx.bake(file, path, resume=True, **options).report
    fresh = tmp_path / "fresh" / "gust.usdc"
    fresh.parent.mkdir()
    featherfx.bake(file, fresh, **options)
    assert content(path.parent) == content(fresh.parent)
    assert len(content(path.parent)) > 0
    assert not [each for each in path.parent.iterdir() if each.name.startswith(".")]
    return report


WIDER = "width = 1.6".join(GROOM.rsplit("width = 1.5", 1))


@pytest.mark.parametrize("layout", ["flat", "payload", "clips"])
def test_a_wider_row_is_simulated_again_and_no_other(earlier, tmp_path, layout):
    report = changed_and_fresh(earlier, tmp_path, WIDER, layout=layout)
    assert report["again"] == {
        "feathers_simulated": 2,
        "feathers_taken_over": 3,
        "changed": ["rows.lower.width: 1.5 -> 1.6"],
    }
    assert report["samples_taken_over"] == 0


def test_a_preset_touches_the_feathers_of_its_kind(earlier, tmp_path):
    folder = tmp_path / "presets" / "feather"
    folder.mkdir(parents=True)
    (folder / "swan_secondary.toml").write_text('base = "swan_secondary"\ncalamus = 0.13\n')
    report = changed_and_fresh(earlier, tmp_path, preset_folders=[tmp_path / "presets"])
    again = report["again"]
    assert (again["feathers_simulated"], again["feathers_taken_over"]) == (3, 2)
    told = " ".join(again["changed"])
    assert "presets.feather/swan_secondary.calamus: " in told
    assert " -> 0.13" in told


@pytest.mark.parametrize(
    ("change", "simulated", "told"),
    [
        (
            '[[shelter]]\nregion = "hand"\nshare = 0.5\n',
            2,
            ["shot.shelter[1].share: not set -> 0.5"],
        ),
        (
            '[overrides."upper_02"]\nlength = 0.2\n'
            '[[detail]]\nfeathers = "lower_01"\nlevel = "rachis"\n'
            '[[force]]\nfeather = "upper_03"\nforce = [0.0, 0.0, 0.01]\n',
            3,
            [
                "overrides.upper_02.length: not set -> 0.2",
                'shot.detail[0].level: not set -> "rachis"',
                "shot.force[0].force: not set -> [0.0, 0.0, 0.01]",
            ],
        ),
    ],
)
def test_what_names_some_feathers_touches_these(earlier, tmp_path, change, simulated, told):
    report = changed_and_fresh(earlier, tmp_path, shot=f"{SHOT}\n{change}")
    assert report["again"]["feathers_simulated"] == simulated
    changed = report["again"]["changed"]
    assert all(any(each in line for line in changed) for each in told)


def test_more_and_fewer_feathers(earlier, tmp_path):
    groom = (
        GROOM.replace("count = 3", "count = 1")
        + GROOM[GROOM.index("[[row]]") :]
        .replace('id = "upper"', 'id = "third"')
        .partition('[[row]]\nid = "lower"')[0]
    )
    report = changed_and_fresh(earlier, tmp_path, groom)
    assert report["again"]["feathers_simulated"] == 3
    changed = report["again"]["changed"]
    assert "rows.upper.count: 3 -> 1" in changed
    # what is new is one line, not one for each of its keys
    assert "rows.third: was not there" in changed
    assert not any("rows.third." in each for each in changed)


def test_a_shorter_range_and_another_name_simulate_nothing(earlier, tmp_path):
    shot = SHOT.replace('name = "gust"', 'name = "gust two"')
    report = changed_and_fresh(earlier, tmp_path, shot=shot, frames=(1, 3), layout="clips")
    again = report["again"]
    assert (again["feathers_simulated"], again["feathers_taken_over"]) == (0, 5)
    assert set(again["changed"]) >= {'shot.name: "gust" -> "gust two"', "frames: 1-5 -> 1-3"}
    assert report["newton_iterations"]["max"] == 0.0


def test_followers_depend_on_their_guides(tmp_path):
    detail = "\n[[detail]]\nregion = 'arm'\nlevel = 'guided'\nevery = 3\n"
    shot, path = written(tmp_path, shot=SHOT + detail), tmp_path / "gust.usdc"
    featherfx.bake(shot, path, **OPTIONS)
    guide = '\n[overrides."upper_02"]\nlength = 0.2\n'
    written(tmp_path, shot=SHOT + detail + guide)
    report = featherfx.bake(shot, path, resume=True, **OPTIONS).report
    # the guide in the middle, and both that follow it; the others are not of its region
    assert report["again"]["feathers_simulated"] == 3
    fresh = tmp_path / "fresh" / "gust.usdc"
    fresh.parent.mkdir()
    featherfx.bake(shot, fresh, **OPTIONS)
    assert path.read_bytes() == fresh.read_bytes()


@pytest.mark.parametrize(
    ("shot", "options", "told"),
    [
        (SHOT.replace("6.0", "7.0"), {}, {"shot.wind.speed": "6.0 -> 7.0"}),
        (SHOT, {"frames": (1, 6)}, {"frames": "1-5 -> 1-6"}),
        (SHOT, {"frames": (2, 5)}, {"frames": "1-5 -> 2-5"}),
        (SHOT, {"up_axis": "Y"}, {"up_axis": '"Z" -> "Y"'}),
        (SHOT + "\n[contact]\n", {}, {"shot.contact": "was not there"}),
    ],
)
def test_what_touches_every_feather_is_refused_in_words(earlier, tmp_path, shot, options, told):
    path = copied(earlier, "flat", tmp_path)
    before = content(path.parent)
    file = written(tmp_path, shot=shot)
    with pytest.raises(InputError) as caught:
        featherfx.bake(file, path, resume=True, **OPTIONS | options)
    found = {problem.key: problem.message for problem in caught.value.problems}
    assert found.items() >= told.items() or any(key in str(found) for key in told)
    assert "sha256" not in str(caught.value)
    assert "--overwrite" in str(caught.value)
    assert content(path.parent) == before


def test_a_file_that_a_value_names_is_told(tmp_path):
    names = "id,kind,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z"
    table = f"{names}\na,swan_primary,0,0,0,-1,0,0,0,0,1\n"
    (tmp_path / "t.csv").write_text(table)
    groom = 'name = "t"\n[[table]]\nfile = "t.csv"\n'
    shot = written(tmp_path, groom)
    path = tmp_path / "gust.usdc"
    featherfx.bake(shot, path, frames=(1, 1))
    (tmp_path / "t.csv").write_text(table.replace("primary,0,0,0", "primary,0,0,1"))
    with pytest.raises(InputError, match=r"table\[0\]\.file \(file\): is another now"):
        featherfx.bake(shot, path, frames=(1, 1), resume=True)


def test_an_interrupted_one_goes_on(earlier, tmp_path):
    path = copied(earlier, "flat", tmp_path)
    shot = written(tmp_path, WIDER)
    seen = []

    def on_frame(done, total):
        seen.append(done)
        if done == 3:
            raise KeyboardInterrupt

    options = OPTIONS | {"layout": "flat", "resume": True}
    with pytest.raises(KeyboardInterrupt, match="2 of 5 samples are kept"):
        featherfx.bake(shot, path, progress=on_frame, **options)
    report = featherfx.bake(shot, path, **options).report
    assert report["samples_taken_over"] == 2
    assert report["again"]["feathers_simulated"] == 2
    fresh = tmp_path / "fresh" / "gust.usdc"
    fresh.parent.mkdir()
    featherfx.bake(shot, fresh, **OPTIONS | {"layout": "flat"})
    assert path.read_bytes() == fresh.read_bytes()


def test_the_command_says_what_it_does(earlier, tmp_path):
    path, shot = copied(earlier, "flat", tmp_path), written(tmp_path, WIDER)
    command = ["bake", shot, "-o", path, "--frames", "1-5", "--chunk", 2, "--layout", "flat"]
    result = invoke(*command, "--resume")
    assert result.exit_code == 0, result.stderr
    assert "2 feathers simulated again, 3 taken over from the cache that was there" in result.stderr
    assert "  rows.lower.width: 1.5 -> 1.6" in result.stderr
