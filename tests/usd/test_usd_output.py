"""All of an output or none of it, whatever goes wrong."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import feathers
import pytest
from pxr import Sdf, Usd

from featherfx import limits
from featherfx.errors import InputError, InputWarning
from featherfx.files import atomic_write
from featherfx.usd.types import OutputError
from featherfx.usd.write import layers
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.layers import format_table
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.output import check_output
from featherfx.usd.write.previous_cache import parse_table, read_metadata

NAMES = {"flat": ["out.usda"], "payload": ["out.animation.usdc", "out.payload.usdc", "out.usda"]}


def bake(path: Path, last: int = 3, then=lambda writer: None, **options) -> None:
    with CacheWriter(path, feathers.entries(), (1, 3), 24.0, WriteOptions(**options)) as writer:
        for number in range(1, last + 1):
            writer.write(feathers.frame(number))
        then(writer)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("layout", ["flat", "payload"])
def test_only_the_named_files_appear(tmp_path, layout):
    bake(tmp_path / "out.usda", layout=layout)
    assert sorted(contents(tmp_path)) == NAMES[layout]


@pytest.mark.parametrize("layout", ["flat", "payload"])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_exception_in_mid_bake_leaves_the_old_files(tmp_path, layout, error):
    bake(tmp_path / "out.usda", layout=layout)
    before = contents(tmp_path)

    def stop_in_the_middle() -> None:
        with CacheWriter(
            tmp_path / "out.usda",
            feathers.entries(),
            (1, 9),
            options=WriteOptions(layout=layout, overwrite=True),
        ) as writer:
            writer.write(feathers.frame(1))
            raise error

    with pytest.raises(error):
        stop_in_the_middle()
    assert contents(tmp_path) == before


def test_missing_frames_are_an_error(tmp_path):
    with pytest.raises(OutputError, match="frames 3 to 3 never came"):
        bake(tmp_path / "out.usda", last=2)
    assert contents(tmp_path) == {}


def test_overwriting_replaces_everything(tmp_path):
    bake(tmp_path / "out.usda", layout="payload")
    first = contents(tmp_path)
    bake(tmp_path / "out.usda", layout="payload", overwrite=True, meters_per_unit=0.01)
    second = contents(tmp_path)
    assert sorted(second) == NAMES["payload"]
    assert all(first[name] != second[name] for name in first)


@pytest.mark.parametrize("failing", range(6))  # settings, chunk, record; then the three files
@pytest.mark.parametrize("existing", [True, False])
def test_a_failed_rename_restores_all_files(tmp_path, monkeypatch, failing, existing):
    if existing:
        bake(tmp_path / "out.usda", layout="payload")
    before = contents(tmp_path)
    real, calls = os.replace, []

    def replace(source, target):
        calls.append(target)
        if len(calls) == failing + 1:
            raise OSError(5, "Input/output error")
        real(source, target)

    def no_link(source, target):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(atomic_write.os, "replace", replace)
    if not existing:  # as on file systems without hard links
        monkeypatch.setattr(atomic_write.os, "link", no_link)
    with pytest.raises(OutputError, match="Input/output error"):
        bake(tmp_path / "out.usda", layout="payload", overwrite=True, meters_per_unit=0.01)
    assert contents(tmp_path) == before


@pytest.fixture
def limit_files():
    """Sets the size in bytes beyond which the system refuses to write to a file."""
    resource = pytest.importorskip("resource", reason="no file size limit to run into")
    was = resource.getrlimit(resource.RLIMIT_FSIZE)
    told = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, was[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, was)
    signal.signal(signal.SIGXFSZ, told)


@pytest.mark.parametrize(
    ("name", "layout", "limit"),
    [("out.usda", "flat", 0), ("out.usdc", "flat", 1500), ("out.usda", "payload", 1500)],
)
def test_a_full_disk_leaves_the_old_file(tmp_path, limit_files, name, layout, limit):
    """The system refuses to write beyond a limit, as it does on a full disk."""
    bake(tmp_path / name, layout=layout)
    before = contents(tmp_path)

    def fill(writer):
        assert writer.samples_done == 3
        limit_files(limit)

    with pytest.raises(InputError, match="not written"):
        bake(tmp_path / name, then=fill, layout=layout, overwrite=True)
    assert contents(tmp_path) == before


def test_an_error_of_export_is_one_message(tmp_path, monkeypatch):
    def fail(path):
        if path.suffix == ".usdc":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic_write, "flush", fail)
    with pytest.raises(OutputError, match=r"0000\.usdc: not written .No space left on device"):
        bake(tmp_path / "out.usda")
    assert contents(tmp_path) == {}


def test_a_file_that_reads_back_differently_is_not_published(tmp_path, monkeypatch):
    def lose_a_sample(layer, path):
        from pxr import Sdf

        less = Sdf.Layer.CreateAnonymous(".usda")
        less.TransferContent(layer)
        less.EraseTimeSample("/out/feathers/primary_1.points", 2)
        return less.Export(str(path))

    monkeypatch.setattr(layers, "_store", lose_a_sample)
    with pytest.raises(OutputError, match=r"differs.*primary_1\.points"):
        bake(tmp_path / "out.usda")
    assert contents(tmp_path) == {}


def test_an_open_reader_keeps_its_file(tmp_path):
    bake(tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    bake(tmp_path / "out.usdc", overwrite=True, meters_per_unit=0.01)
    points = stage.GetPrimAtPath("/out/feathers/covert").GetAttribute("points").Get()
    assert max(abs(p[0]) for p in points) < 1


def test_output_is_checked_before_any_work(tmp_path):
    (tmp_path / "there.usda").write_text("mine")
    (tmp_path / "folder.usdc").mkdir()
    (tmp_path / "two.payload.usdc").write_text("mine")
    wrong = {
        "there.usda": "exists already",
        "folder.usdc": "is a folder",
        "a.abc": "suffix '.abc' is not one of .usd, .usda, .usdc",
        "none/a.usda": "folder does not exist",
        "there.usda/a.usda": "is not a folder",
    }
    for name, message in wrong.items():
        with pytest.raises(InputError, match=message):
            check_output(tmp_path / name)
        with pytest.raises(InputError, match=message):
            CacheWriter(tmp_path / name, feathers.entries(), None)
    with pytest.raises(OutputError, match=r"two\.payload\.usdc: exists already"):
        check_output(tmp_path / "two.usda", layout="payload")
    assert check_output(tmp_path / "there.usda", overwrite=True) == tmp_path / "there.usda"
    assert (tmp_path / "there.usda").read_text() == "mine"


def test_a_read_only_folder_is_found_by_trying(tmp_path, monkeypatch):
    def refuse(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("featherfx.usd.write.output.tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match="cannot write to this folder: Permission denied"):
        check_output(tmp_path / "a.usda")


def test_all_wrong_arguments_are_named_at_once(tmp_path):
    twice = [feathers.entries()[0]] * 2
    with pytest.raises(OutputError) as caught:
        CacheWriter(
            tmp_path / "a.usda",
            twice,
            (5, 1),
            float("nan"),
            WriteOptions(meters_per_unit=0, up_axis="X"),
        )
    keys = [problem.key for problem in caught.value.problems]
    assert keys == ["feathers", "frames", "frames_per_second", "meters_per_unit", "up_axis"]


def test_asking_needs_no_usd():
    code = "import sys, featherfx.usd, featherfx.usd.write.output; sys.exit('pxr' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_an_output_that_its_disk_has_no_room_for_is_refused_before_the_work(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    with pytest.raises(InputError, match=r"its disk has 1 kB left. Make room"):
        bake(tmp_path / "out.usda")
    assert not contents(tmp_path)


def test_the_size_of_a_large_output_is_told_before_the_work_and_right(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MIN_LARGE_OUTPUT", 1.0)
    with pytest.warns(InputWarning, match="out.usdc: takes about") as warned:
        bake(tmp_path / "out.usdc")
    number, unit = re.search(r"about ([0-9.]+) (kB|MB)", str(warned[0].message)).groups()
    told = float(number) * {"kB": 1e3, "MB": 1e6}[unit]
    assert told == pytest.approx((tmp_path / "out.usdc").stat().st_size, rel=0.5)
    assert str(warned[0].message).endswith("Give --as condensed or --velocities none for less")
    with pytest.warns(InputWarning, match="Bake fewer frames for less"):
        bake(tmp_path / "small.usdc", form="condensed")


def test_reading_compiles_nothing():
    """Readers, checks, exports and a finished bake that is resumed do without numba."""
    modules = (
        "read.cache",
        "read.groom",
        "read.skin",
        "check.check",
        "convert.mesh_files",
        "convert.condensed",
        "write.previous_cache",
    )
    code = "; ".join(f"import featherfx.usd.{name}" for name in modules)
    code += "; import featherfx.baking.task, sys; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("count", [0, 3, 5000])
def test_long_texts_of_a_cache_are_kept_in_pieces_that_others_read(tmp_path, count):
    table = {f"feather_{k}": f"depends on {k} µm" for k in range(count)}
    layer = Sdf.Layer.CreateNew(str(tmp_path / "long.usdc"))
    layer.customLayerData = {"featherfx": {"dependences": format_table(table)}}
    layer.Save()
    del layer
    told = read_metadata(tmp_path / "long.usdc")["dependences"]
    assert parse_table(told) == table
    pieces = [told] if isinstance(told, str) else [*told]
    assert max(map(len, pieces)) < 65_536


READER = """
import select, sys
import numpy as np
from pxr import Tf, Usd, UsdGeom
print("begin", flush=True)
seen, count = set(), 0
while not select.select([sys.stdin], [], [], 0.01)[0]:
    sizes, count = [], count + 1
    try:
        stage = Usd.Stage.Open(sys.argv[1])
        for prim in Usd.PrimRange(stage.GetPseudoRoot()):
            if prim.IsA(UsdGeom.Mesh):
                points = UsdGeom.Mesh(prim).GetPointsAttr()
                codes = points.GetTimeSamples() or [Usd.TimeCode.Default()]
                sizes += [float(np.ptp(np.array(points.Get(code)))) for code in codes]
        scale = UsdGeom.GetStageMetersPerUnit(stage)
        seen.add(str([round(scale * each, 4) for each in sizes]))
        del stage, prim, points  # else the next stage would have the same layers
    except Tf.ErrorException as error:
        seen.add(str(error))
print(count, *seen, sep="\\n")
"""


def test_who_reads_while_bakes_write_sees_one_cache(tmp_path):
    """Two processes read the cache that bakes in other units replace, and measure lengths."""
    path = tmp_path / "out.usda"
    bake(path)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", READER, path]
    readers = [subprocess.Popen(command, **pipes) for _ in range(2)]
    assert [reader.stdout.readline() for reader in readers] == ["begin\n"] * 2
    for unit in (0.01, 1.0) * 4:
        bake(path, overwrite=True, meters_per_unit=unit)
    for reader in readers:
        count, *seen = reader.communicate("")[0].splitlines()
        assert int(count) > 8
        assert len(seen) == 1, seen
