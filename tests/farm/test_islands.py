"""Feathers that touch: islands are shares, and what a change touches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from farm.farm_cases import SerialEngine, options_of
from farm.flock import flock

import featherfx
from featherfx.baking import pipeline
from featherfx.errors import InputError, InputWarning
from featherfx.farm.job import Job
from featherfx.shot.contact.partition import share_numbers, shot_islands


def one(folder: Path, birds: int = 3, apart: float = 1.5, more: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    return flock(folder, birds, apart, more)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A flock, and the bytes of its bake."""
    shot = one(tmp_path_factory.mktemp("flock"), birds=2)
    featherfx.bake(shot, shot.with_suffix(".usdc"), chunk=2)
    return shot, shot.with_suffix(".usdc").read_bytes()


def test_birds_that_are_apart_are_islands_until_they_come_near(tmp_path):
    read = featherfx.read_shot(one(tmp_path))
    assert shot_islands(read).tolist() == np.repeat([0, 1, 2], 8).tolist()
    assert set(shot_islands(featherfx.read_shot(one(tmp_path, apart=0.4)))) == {0}
    # a bird that is led to its neighbour within the shot
    groom = tmp_path / "flock_groom.toml"
    shot = one(tmp_path, birds=2)
    text = shot.read_text().replace("frames = [1, 3]", "frames = [1, 30]")
    keys = """
[motion]
kind = "keys"
[[motion.keyframes]]
joint = "b0_body"
time = 0.0
position = [0, 0, 0]
[[motion.keyframes]]
joint = "b0_body"
time = 0.5
position = [1.2, 0, 0]
"""
    lines = [line for line in text.splitlines() if not line.startswith("motion")]
    shot.write_text("\n".join(lines) + keys)
    assert groom.exists()
    assert set(shot_islands(featherfx.read_shot(shot))) == {0}


def test_shares_of_islands_have_the_bytes_of_the_whole(tmp_path, whole):
    shot, expected = whole
    engine = SerialEngine()
    output = tmp_path / "flock.usdc"
    options = options_of(chunk=2)
    job = Job([shot], [output], options, engine, 2, lambda done, total: None)
    (told,) = job.run()
    assert output.read_bytes() == expected
    assert [each["feathers"] for each in told["shares"]] == [8, 8]


def test_an_island_stays_whole_and_the_plan_says_so(tmp_path):
    shot = one(tmp_path)
    read = featherfx.read_shot(shot)
    assert [len(share_numbers(read, k, 3)) for k in (1, 2, 3)] == [8, 8, 8]
    with pytest.raises(InputError, match="N at most 3, the number of islands"):
        share_numbers(read, 1, 4)
    with pytest.warns(InputWarning, match="3 instead of 6, the largest with 8 of 24 feathers"):
        pipeline.plan(shot, tmp_path / "flock.usdc", 6)
    assert (tmp_path / "flock.plan.json").read_text().count("--feathers") == 3


def again_and_fresh(shot: Path, change: Callable[[], object], **options: object) -> dict:
    """What a bake does again after a change; its bytes are those of a fresh one."""
    output, fresh = shot.with_suffix(".usdc"), shot.parent / "fresh" / f"{shot.stem}.usdc"
    fresh.parent.mkdir(exist_ok=True)
    featherfx.bake(shot, output, **options)
    change()
    report = featherfx.bake(shot, output, resume=True, **options).report
    featherfx.bake(shot, fresh, **options)
    assert output.read_bytes() == fresh.read_bytes()
    return report["again"]


def test_after_a_change_only_its_island_is_simulated(tmp_path):
    shot = one(tmp_path, birds=2)
    with shot.open("a") as file:
        file.write('[overrides]\n"b1_right_primary_01" = { rachis = { camber = 12 } }\n')

    def change():
        shot.write_text(shot.read_text().replace("camber = 12", "camber = 14"))

    assert again_and_fresh(shot, change)["feathers_simulated"] == 8


def test_what_pushes_nothing_joins_no_islands_and_is_dealt_out(tmp_path):
    """Of two birds whose primaries would meet, and whose secondaries alone do not."""
    some = 'kinds = ["swan_secondary"]\n'
    read = featherfx.read_shot(flock(tmp_path, 2, 0.7, some, row=4))
    islands = shot_islands(read)
    pushing = np.array([p.kind.name == "swan_secondary" for p in read.groom.feathers])
    assert (islands[~pushing] == -1).all()
    assert np.bincount(islands[pushing]).tolist() == [8, 8]
    shares = [share_numbers(read, k, 2) for k in (1, 2)]
    assert sorted(np.concatenate(shares).tolist()) == list(range(32))
    for each in shares:
        assert [int(pushing[each].sum()), len(set(islands[each][pushing[each]]))] == [8, 1]
        assert len(each) == 16
    assert {len(share_numbers(read, k, 16)) for k in range(1, 17)} == {1, 9}


def test_thousands_of_feathers_at_one_place_are_refused(tmp_path):
    """What compares each with those around would not end; without that, they are read."""
    head = "id,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z\n"
    rows = [f"f{k},{k % 12},0,0,-1,0,0,0,0,1\n" for k in range(4000)]
    (tmp_path / "a.csv").write_text(head + "".join(rows))
    groom = tmp_path / "groom.toml"
    groom.write_text('name = "g"\n[[table]]\nfile = "a.csv"\nkind = "covert"\n')
    text = 'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\nquality = "draft"\n'
    shot = tmp_path / "shot.toml"
    shot.write_text(text + "[contact]\n")
    with pytest.raises(InputError, match=r"contact\.regions: 4000 feathers make at least 664668"):
        pipeline.plan(shot, tmp_path / "s.usdc", 2)
    shot.write_text(text)
    with pytest.raises(InputError, match=r"groom: 4000 .* give all a share in \[\[shelter\]\]"):
        featherfx.read_shot(shot)
    shot.write_text(text + "[[shelter]]\nshare = 0\n")
    assert len(featherfx.read_shot(shot).groom.feathers) == 4000
    (tmp_path / "skin.usda").write_text(
        '#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Z"\n)\ndef Mesh "skin"\n{\n'
        "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n"
        "point3f[] points = [(-1, -1, 0), (12, -1, 0), (0, 1, 0)]\n}\n"
    )
    skin = '[skin]\nusd = "skin.usda"\nprim = "/skin"\n'
    region = '[[region]]\nid = "r"\nkind = "covert"\ncount = 1\nflow = { direction = [-1, 0, 0] }\n'
    groom.write_text(groom.read_text() + skin + region + "[layout]\n")
    with pytest.raises(InputError, match=r"layout: 4001 .* \(beside 'f0' stand 333\)\. Place them"):
        featherfx.read_shot(shot)
