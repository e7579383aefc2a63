"""What was computed once is taken from the store, and never what is damaged or others may write."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.files import disk_cache
from featherfx.files.disk_cache import Aside, digest, kept
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.read.read import read_shot

ROOT = Path(disk_cache.__file__).parents[2]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "content"


def counted(calls, value=1.0, size=3):
    def compute():
        calls.append(1)
        return {"values": np.full(size, value), "name": np.array(["a", "bc"])}

    return compute


def found(calls, inputs=("x",), **more):
    arrays = kept("trial", inputs, counted(calls, **more))
    return arrays["values"].tolist(), arrays["name"].tolist()


def test_the_same_content_is_computed_once(folder):
    calls = []
    expected = ([1.0, 1.0, 1.0], ["a", "bc"])
    assert [found(calls), found(calls)] == [expected, expected]
    assert len(calls) == 1
    assert found(calls, inputs=("y",), value=2.0)[0] == [2.0, 2.0, 2.0]
    assert len(calls) == 2


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "foreign"])
def test_a_damaged_entry_counts_as_missing(folder, damage):
    calls = []
    found(calls)
    (file,) = folder.glob("trial.*")
    whole = file.read_bytes()
    broken = bytearray(whole)
    broken[len(whole) // 2] ^= 1
    content = {"cut": whole[:-9], "flip": broken, "empty": b"", "foreign": b"PK\3\4" + whole}
    file.write_bytes(bytes(content[damage]))
    assert found(calls)[0] == [1.0, 1.0, 1.0]
    assert len(calls) == 2
    assert file.read_bytes() == whole


def test_nothing_is_unpickled(folder):
    """An array of objects, soundly stored, is no array of this program."""
    calls = []
    found(calls)
    (file,) = folder.glob("trial.*")
    bad = folder / "bad.npz"
    np.savez(bad, values=np.array([{"a": 1}], dtype=object))
    content = bad.read_bytes()
    file.write_bytes(disk_cache.hashlib.sha256(content).digest() + content)
    assert found(calls)[0] == [1.0, 1.0, 1.0]
    assert len(calls) == 2


def test_a_folder_that_others_can_write_to_is_neither_read_nor_written(folder):
    calls = []
    found(calls)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    folder.chmod(0o777)
    assert found(calls, value=5.0)[0] == [5.0, 5.0, 5.0]
    assert len(calls) == 2
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    folder.chmod(0o700)
    assert found(calls)[0] == [1.0, 1.0, 1.0]


def test_a_folder_that_cannot_be_written_to_costs_time_only(folder, monkeypatch):
    calls = []
    found(calls)
    folder.chmod(0o500)

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    # root may write to any folder
    monkeypatch.setattr(disk_cache.os, "replace", refused)
    monkeypatch.setattr(disk_cache.os, "access", lambda *_: False)
    assert [found(calls)[0] for _ in range(2)] == [[1.0] * 3] * 2
    assert len(calls) == 1
    assert [found(calls, ("z",), value=3.0)[0] for _ in range(2)] == [[3.0] * 3] * 2
    assert len(calls) == 3
    folder.chmod(0o700)
    assert len(list(folder.iterdir())) == 1


def test_what_was_used_least_lately_goes_first(folder, monkeypatch):
    calls = []
    size = 1000
    monkeypatch.setenv("FEATHERFX_CACHE_SIZE", str(30_000 / 1e9))
    for number in range(6):
        found(calls, inputs=(number,), size=size)
        for file in folder.glob("trial.*"):
            stamp = os.stat(file).st_mtime_ns - 10**9
            os.utime(file, ns=(stamp, stamp))
        found(calls, inputs=(0,), size=size)  # used all the time
    left = sum(file.stat().st_size for file in folder.glob("trial.*"))
    assert 10_000 < left <= 30_000
    assert len(calls) == 6
    found(calls, inputs=(1,), size=size)
    assert len(calls) == 7


def test_what_changes_again_and_again_is_kept_aside(folder):
    calls = []
    found(calls, ("disk",))
    aside, files = Aside(), len(list(folder.iterdir()))
    for wanted, computed in (("disk a", 2), ("a disk b", 3), ("b", 3), ("b", 3), ("a", 4)):
        with aside:
            for each in wanted.split():
                arrays = kept("trial", (each,), counted(calls))
                assert arrays["values"].tolist() == [1.0] * 3
                arrays["values"][:] = 7.0  # which is nobody else's
        assert len(calls) == computed
    assert len(list(folder.iterdir())) == files


def test_a_size_of_zero_keeps_nothing(folder, monkeypatch):
    monkeypatch.setenv("FEATHERFX_CACHE_SIZE", "0")
    calls = []
    found(calls)
    found(calls)
    assert len(calls) == 2
    assert not folder.exists()


@pytest.mark.parametrize("size", ["lots", "-1", "nan", "2 GB"])
def test_a_size_that_is_none_is_an_error(folder, monkeypatch, size):
    monkeypatch.setenv("FEATHERFX_CACHE_SIZE", size)
    with pytest.raises(InputError, match=f"FEATHERFX_CACHE_SIZE: '{size}' is no number of GB"):
        found([])


def test_processes_wait_for_the_one_that_computes(folder, tmp_path):
    code = (
        "import time, numpy as np\n"
        "from featherfx.files.disk_cache import kept\n"
        "def compute():\n"
        "    print('computed', flush=True)\n"
        "    time.sleep(1.0)\n"
        "    return {'values': np.arange(4)}\n"
        "assert kept('trial', ('shared',), compute)['values'].tolist() == [0, 1, 2, 3]\n"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT)
        for _ in range(3)
    ]
    told = [process.communicate(timeout=60)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0, 0]
    assert "".join(told) == "computed\n"


def test_digests_tell_values_apart():
    values = [
        1, 1.0, True, "1", None, (1,), ((1,),), (1, 1), "", (), {"a": 1}, {"a": 2}, {"b": 1},
        np.ones(3), np.ones(3, dtype=np.float32), np.ones((3, 1)), np.zeros(3), 0.0, -0.0,
    ]  # fmt: skip
    assert len({digest(value) for value in values}) == len(values)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    with pytest.raises(TypeError, match="has no digest"):
        digest(object())


def test_what_follows_from_a_shot_is_found_again_where_its_settings_are_told(folder):
    shot, calls = read_shot(ROOT / "samples/feather_pull/shot.toml"), []

    def values(shot, value):
        run = ShotRun(shot, 1, 1, None)
        return run.kept("trial", [], counted(calls, value))["values"][0]

    assert [values(shot, 1.0), values(shot, 2.0)] == [1.0, 2.0]  # nobody has told them
    assert shot.settings["last_frame"]
    assert [values(shot, 3.0), values(shot, 4.0)] == [3.0, 3.0]
    other = replace(shot, last_frame=shot.last_frame + 1)
    assert values(other, 5.0) == 5.0
    assert other.settings["last_frame"]
    assert values(other, 6.0) == 6.0
    assert len(calls) == 5
