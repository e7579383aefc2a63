"""Sizes that no groom has: refused at once, or read in time that grows as they do."""

from __future__ import annotations

import difflib
import os
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from featherfx.errors import InputError, Problem
from featherfx.groom.read.read import read_groom
from featherfx.limits import memory_limit, refuse_beyond_memory
from featherfx.shot.read.read import check_file

FEATHER = '[[feather]]\nid = "a"\nkind = "covert"\nposition = [0, 0, 0]\n'
ROW = """
[[row]]
id = "r{}"
kind = "covert"
count = 100000
first = {{ position = [0, -1, 0], direction = [-1, 0, 0], up = [0, 0, 1] }}
last = {{ position = [0, -2, 0], direction = [0, -1, 0], up = [0, 0, 1] }}
"""
TABLE = '[[table]]\nfile = "{}"\nkind = "covert"\n'
COLUMNS = "id,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z,region\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "groom.toml"
    path.write_text('name = "test"\n' + text, encoding="utf-8")
    return path


def found(folder: Path, text: str) -> list[str]:
    path = write(folder, text)
    with pytest.raises(InputError) as caught:
        read_groom(path)
    return [str(each).replace(f"{folder}/", "") for each in caught.value.problems]


def test_unknown_keys_are_compared_and_listed_up_to_a_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    search = difflib.get_close_matches
    monkeypatch.setattr(
        difflib, "get_close_matches", lambda *a, **k: calls.append(a) or search(*a, **k)
    )
    problems = found(tmp_path, "\n".join(f"key{i} = 1" for i in range(20_000)) + "\n" + FEATHER)
    assert problems[0].startswith("groom.toml: key0: unknown key, ")
    assert problems[-1] == "groom.toml: and 19900 more problems"
    assert len(problems) == 101
    assert len(calls) <= 100


def test_long_chains_of_joints_take_linear_time(tmp_path: Path) -> None:
    joints = [
        f'[[joint]]\nname = "j{i}"\nposition = [0, 0, 0]\nparent = "{f"j{i - 1}" if i else ""}"\n'
        for i in range(2000)
    ]
    begin = time.perf_counter()
    groom = read_groom(write(tmp_path, "".join(joints) + FEATHER))
    assert time.perf_counter() - begin < 10.0
    assert len(groom.joints) == 2000


def test_a_cycle_of_joints_is_told_once(tmp_path: Path) -> None:
    def joint(name: str, parent: str) -> str:
        return f'[[joint]]\nname = "{name}"\nposition = [0, 0, 0]\nparent = "{parent}"\n'

    text = joint("tail", "a") + joint("a", "b") + joint("b", "c") + joint("c", "a")
    advice = "Give one of them another parent"
    problems = found(tmp_path, text + joint("own", "own") + FEATHER)
    assert problems == [
        f"groom.toml: joint[1].parent: joint cycle: a -> b -> c -> a. {advice}",
        f"groom.toml: joint[4].parent: joint cycle: own -> own. {advice}",
    ]
    many = "".join(joint(f"j{i}", f"j{(i + 1) % 4000}") for i in range(4000))
    (problem,) = found(tmp_path, many + FEATHER)
    assert problem.endswith(" -> ... -> j0. Give one of them another parent")
    assert len(problem) < 300


def test_feathers_are_counted_before_they_are_made(tmp_path: Path) -> None:
    tracemalloc.start()
    problems = found(tmp_path, "".join(ROW.format(i) for i in range(11)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert problems == ["groom.toml: row: asks for 1100000 feathers in all. Give at most 1000000"]
    assert peak < 30e6


@pytest.mark.parametrize("text", ["x" + ".x" * 500_000 + " = 1", "x = " + "[" * 5000])
def test_deep_nesting_is_a_problem(tmp_path: Path, text: str) -> None:
    assert found(tmp_path, text) == ["groom.toml: tables and arrays are nested deeper than 64"]


def test_nesting_that_can_be_read_is_bounded_too(tmp_path: Path) -> None:
    deep = "x = { " + "a.a.a.a.a.a.a.a = { " * 10 + "a = 1" + " }" * 11
    assert found(tmp_path, deep) == ["groom.toml: tables and arrays are nested deeper than 64"]


def test_large_toml_is_refused_unread(tmp_path: Path) -> None:
    path = write(tmp_path, "")
    with path.open("r+") as file:
        file.truncate(50_000_000)
    (problem,) = check_file(path)
    assert problem.message.startswith("has 50 MB, more than 8 MB. Put thousands of feathers into a")


def test_pipes_and_devices_are_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    os.mkfifo(tmp_path / "pipe.toml")
    text = TABLE.format("pipe.csv") + TABLE.format("/dev/zero") + TABLE.format(".")
    assert found(tmp_path, text) == [
        "pipe.csv: is not a regular file, expects a CSV or NPZ file",
        "/dev/zero: is not a regular file, expects a CSV or NPZ file",
        f"{tmp_path}: is a folder, expects a CSV or NPZ file",
    ]
    for path in (tmp_path / "pipe.toml", Path("/dev/zero")):
        (problem,) = check_file(path)
        assert problem.message == "is not a regular file, expects a TOML file"


def test_names_are_one_line(tmp_path: Path) -> None:
    text = FEATHER.replace('"a"', '"a\\nb"') + FEATHER.replace('"a"', f'"{"x" * 2000}"')
    assert found(tmp_path, text + '"k\\n\\u0000" = 1') == [
        "groom.toml: feather[0].id: 'a\\nb' holds a line break or a control character",
        "groom.toml: feather[1].id: has 2000 characters. Give at most 1000",
        "groom.toml: feather[1].k\\n\\x00: unknown key, known: " + ", ".join(sorted(KEYS)),
    ]
    (tmp_path / "a.csv").write_text(COLUMNS + '"a\nb",0,0,0,1,0,0,0,0,1,' + "y" * 2000 + "\n")
    assert found(tmp_path, TABLE.format("a.csv")) == [
        "a.csv: row 1.id: 'a\\nb' holds a line break or a control character",
        "a.csv: row 1.region: has 2000 characters. Give at most 1000",
    ]


KEYS = (
    *("id", "kind", "position", "direction", "up", "rotation", "region", "joint", "side"),
    *("mirror", "scale", "width", "roll", "stiffness", "weight", "overrides"),
)


def header(shape: tuple[int, ...], kind: str) -> bytes:
    """The start of an NPY file that says to hold more than it does."""
    text = str({"descr": kind, "fortran_order": False, "shape": shape})
    text += " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize(
    ("shape", "kind", "told"),
    [
        ((3 * 10**12,), "<f8", "holds more than 1000000 rows"),
        ((1000, 10**12), "<f8", "position.npy would take 8e+09 MB, more than 500 MB"),
        ((1_000_000,), "<U100000", "position.npy would take 400000 MB, more than 500 MB"),
    ],
)
def test_heads_of_arrays_are_read_first(
    tmp_path: Path, shape: tuple[int, ...], kind: str, told: str
) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("position.npy", header(shape, kind) + bytes(8_000_000))
        archive.writestr("bomb.npy", header((10**9,), "<f8"))
    assert found(tmp_path, TABLE.format("a.npz")) == [f"a.npz: cannot be read: {told}"]


def test_damaged_archives_are_one_problem_each(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "sound.npz", id=np.array(["a", "b"]), position=np.zeros((2, 3)))
    sound = (tmp_path / "sound.npz").read_bytes()
    for place in range(0, len(sound), 5):
        damaged = bytearray(sound)
        damaged[place] ^= 0xFF
        (tmp_path / "a.npz").write_bytes(damaged)
        assert found(tmp_path, TABLE.format("a.npz"))


def test_tables_have_a_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("featherfx.groom.read.table.MAX_FEATHERS", 3)
    row = "f{},0,0,0,1,0,0,0,0,1,\n"
    (tmp_path / "a.csv").write_text(COLUMNS + "".join(row.format(i) for i in range(4)))
    assert found(tmp_path, TABLE.format("a.csv")) == [
        "a.csv: cannot be read: holds more than 3 rows"
    ]


def test_plain_ids_are_looked_up_not_matched(tmp_path: Path) -> None:
    rows = "".join(f"f{i},0,0,0,1,0,0,0,0,1,\n" for i in range(2000))
    (tmp_path / "a.csv").write_text(COLUMNS + rows)
    rules = "".join(f"f{i} = {{ scale = 2 }}\n" for i in range(2000))
    begin = time.perf_counter()
    groom = read_groom(write(tmp_path, TABLE.format("a.csv") + "[overrides]\n" + rules))
    assert time.perf_counter() - begin < 10.0
    assert {each.size for each in groom.feathers} == {2.0}


def test_memory_that_is_not_there_is_refused_with_an_estimate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("FEATHERFX_MEMORY", "2.5")
    assert memory_limit()[0] == 2.5e9
    refuse_beyond_memory(2.4e9, "a.toml", "", "it")
    with pytest.raises(InputError) as caught:
        refuse_beyond_memory(3.1e12, "a.toml", "", "it")
    assert str(caught.value) == (
        "a.toml: it would need about 3.1 TB of memory, more than the 2.5 GB that FEATHERFX_MEMORY "
        "allows"
    )
    for wrong in ("many", "0", "nan"):
        monkeypatch.setenv("FEATHERFX_MEMORY", wrong)
        with pytest.raises(InputError, match="is no number of GB above 0"):
            memory_limit()
    monkeypatch.delenv("FEATHERFX_MEMORY")
    with pytest.raises(InputError, match=r"that are there \(FEATHERFX_MEMORY, in GB, sets"):
        refuse_beyond_memory(1e18, "a.toml", "", "it")


def test_a_problem_is_one_line() -> None:
    assert str(Problem("a\nb", "k\x00", "tail\u2028end")) == "a\\nb: k\\x00: tail\\u2028end"
