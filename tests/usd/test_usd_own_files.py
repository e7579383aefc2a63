"""What a bake removes or replaces is its own; what others put there stays."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import feathers
import pytest
from places import SAMPLES

from featherfx.baking.options import BakeOptions
from featherfx.baking.task import prepare
from featherfx.errors import InputError
from featherfx.files import atomic_write
from featherfx.files.atomic_write import into, write_all, write_text
from featherfx.usd.types import OutputError
from featherfx.usd.write import unfinished_cache
from featherfx.usd.write.cache_writer import CacheWriter, Continuation
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.output import check_output, parts_folder
from featherfx.usd.write.previous_cache import remove_finished_parts

SETTINGS = {"shot": "one"}
GOES_ON = Continuation(SETTINGS)


def bake(path: Path, last: int = 3, before_end=None, continuation=None, **options) -> None:
    written = WriteOptions(**{"chunk": 1, **options})
    with CacheWriter(
        path, feathers.entries(), (1, 3), 24.0, written, continuation=continuation
    ) as writer:
        for number in range(1 + writer.samples_done, last + 1):
            writer.write(feathers.frame(number), lambda path: path.write_bytes(b"state"))
        if before_end:
            before_end()


def stopped(path: Path, **options) -> Path:
    """The folder of a bake that was stopped after two of its three chunks."""
    with pytest.raises(OutputError, match="never came"):
        bake(path, 2, continuation=GOES_ON, **options)
    (record,) = path.parent.rglob("0001.json")
    return record.parent


def tree(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


@pytest.mark.parametrize("layout", ["clips", "flat"])
def test_a_folder_of_others_in_the_place_of_the_chunks_is_an_error(tmp_path, layout):
    path = tmp_path / "o.usdc"
    folder = tmp_path / {"clips": "o.clips", "flat": ".o.usdc.parts"}[layout]
    (folder / "plates").mkdir(parents=True)
    (folder / "plates" / "0001.usdc").write_text("mine")
    before = tree(tmp_path)
    with pytest.raises(OutputError, match=r"holds others' files \(plates\). Choose another name"):
        bake(path, layout=layout)
    assert tree(tmp_path) == before


def test_a_link_in_the_place_of_the_chunks_is_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "plates").mkdir(parents=True)
    (tmp_path / "o.clips").symlink_to(elsewhere)
    with pytest.raises(OutputError, match=r"o\.clips: is a link, which is not followed. Remove it"):
        bake(tmp_path / "o.usdc", layout="clips")
    assert [each.name for each in elsewhere.iterdir()] == ["plates"]


def test_only_what_bakes_recorded_is_removed_when_a_cache_is_replaced(tmp_path):
    path = tmp_path / "o.usdc"
    bake(path, layout="clips")
    folder = tmp_path / "o.clips"
    (old,) = folder.iterdir()
    (folder / "plates").mkdir()
    (folder / "plates" / "0001.usdc").write_text("mine")
    (old / "notes.txt").write_text("mine")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "bake.json").write_text("mine")
    (folder / ("0" * 16)).symlink_to(elsewhere)
    bake(path, layout="clips", overwrite=True, meters_per_unit=0.01)
    assert tree(old) == {"notes.txt": b"mine"}
    assert tree(folder / "plates") == {"0001.usdc": b"mine"}
    assert tree(elsewhere) == {"bake.json": b"mine"}
    (new,) = (each.parent for each in folder.rglob("bake.json") if not each.parent.is_symlink())
    assert (new / "0002.usdc").is_file()


@pytest.mark.parametrize("layout", ["clips", "flat", "payload"])
def test_what_a_killed_bake_left_is_removed_by_the_next(tmp_path, layout):
    path = tmp_path / "o.usdc"
    bake(path, layout=layout)
    names = set(tree(tmp_path))
    for name in (".o.4242.tmp.usdc", ".o.payload.4242.old.usdc", ".o.7.tmp.ga87EY"):
        (tmp_path / name).write_text("half")
    for name in (".o.notes.usdc", ".other.4242.tmp.usdc"):
        (tmp_path / name).write_text("mine")
    (tmp_path / ".o.usdc.lock").touch()
    bake(path, layout=layout, overwrite=True)
    assert set(tree(tmp_path)) == names | {".o.notes.usdc", ".other.4242.tmp.usdc"}


@pytest.mark.parametrize("layout", ["clips", "flat", "payload"])
def test_what_a_bake_left_that_was_killed_when_all_was_there_is_removed(
    tmp_path, layout, monkeypatch
):
    path, other = tmp_path / "killed/o.usdc", tmp_path / "undisturbed/o.usdc"
    path.parent.mkdir()
    other.parent.mkdir()
    with monkeypatch.context() as killed:
        killed.setattr(unfinished_cache.Parts, "finish", lambda self, keep_chunks: self.close())
        killed.setattr(unfinished_cache.Lock, "release", lambda lock: lock._lock.release())
        bake(path, layout=layout, continuation=GOES_ON)
    assert ".o.usdc.lock" in tree(path.parent)
    bake(other, layout=layout, continuation=GOES_ON)
    for _ in range(2):
        remove_finished_parts(path, SETTINGS)
        assert tree(path.parent) == tree(other.parent)


@pytest.mark.parametrize("suffix", [".png", ".ply", ".usda"])
def test_what_killed_processes_left_is_removed_where_its_target_is_written(tmp_path, suffix):
    ended = subprocess.Popen(["true"])
    ended.wait()
    left = [f".o.{ended.pid}.{label}{suffix}" for label in ("tmp", "old")]
    link = f".o.{ended.pid}.tmp.Ab3dEf"
    others = [
        f".o.{os.getppid()}.tmp{suffix}",
        f".o.7.{ended.pid}.tmp{suffix}",
        f".o.notes{suffix}",
    ]
    for each in (*left, *others):
        (tmp_path / each).write_text("half")
    (tmp_path / link).symlink_to(tmp_path / others[0])
    write_text(tmp_path / f"o{suffix}", "whole")
    assert set(tree(tmp_path)) == {f"o{suffix}", link, *others}


def damaged_record(file: Path) -> None:
    content = json.loads(file.read_text())
    content["low"][0] -= 1.0
    file.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("0001.npz", lambda file: file.write_bytes(b"stat!")),
        ("0001.npz", lambda file: file.write_bytes(b"")),
        ("0001.npz", Path.unlink),
        ("0000.json", damaged_record),
        ("0001.json", damaged_record),
        ("0001.json", lambda file: file.write_text("{}")),
        ("0001.json", lambda file: file.write_text("[]")),
        ("0001.json", lambda file: file.write_text('{"codes": 3}')),
        ("bake.json", lambda file: file.write_text("{}")),
        ("bake.json", lambda file: file.write_text("[" * 100_000)),
        ("bake.json", lambda file: file.write_text('{"format": "3", "settings": [1]}')),
    ],
)
def test_a_resumed_bake_trusts_only_what_it_wrote(tmp_path, name, damage):
    whole, path = tmp_path / "whole" / "o.usdc", tmp_path / "o.usdc"
    whole.parent.mkdir()
    bake(whole, continuation=GOES_ON)
    damage(stopped(path) / name)
    bake(path, resume=True, continuation=GOES_ON)
    assert path.read_bytes() == whole.read_bytes()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["o.usdc", "whole"]


def test_sound_chunks_are_taken_over(tmp_path):
    path = tmp_path / "o.usdc"
    folder = stopped(path)
    kept = (folder / "0000.usdc").stat().st_ino
    (folder / ".0002.4242.tmp.usdc").write_text("half")
    (folder / ".0002.4242.tmp.ga87EY").write_text("half")
    with CacheWriter(
        path, feathers.entries(), (1, 3), options=WriteOptions(chunk=1, resume=True),
        continuation=GOES_ON,
    ) as writer:  # fmt: skip
        assert writer.samples_done == 2
        assert (folder / "0000.usdc").stat().st_ino == kept
        assert not [*folder.glob(".0002.4242.tmp.*")]
        writer.write(feathers.frame(3))


@pytest.mark.parametrize("layout", ["clips", "flat", "payload"])
@pytest.mark.parametrize("existing", [True, False])
def test_what_another_program_wrote_meanwhile_is_not_replaced(tmp_path, layout, existing):
    path = tmp_path / "o.usdc"
    if existing:
        bake(path, layout=layout)
    with pytest.raises(OutputError, match=r"o\.usdc: another program has written it meanwhile"):
        bake(path, before_end=lambda: path.write_text("theirs"), layout=layout, overwrite=existing)
    assert path.read_text() == "theirs"
    if not existing:
        assert set(tree(tmp_path)) == {"o.usdc"}


def test_a_file_that_appears_at_the_last_moment_is_not_replaced(tmp_path, monkeypatch):
    real = atomic_write.standing

    def late(path):
        found = real(path)
        path.write_text("theirs")
        return found

    monkeypatch.setattr(atomic_write, "standing", late)
    path = tmp_path / "o.usdc"
    with pytest.raises(FileExistsError, match="meanwhile"):
        write_all([(path, into(lambda file: file.write(b"ours")))], {path: None})
    assert tree(tmp_path) == {"o.usdc": b"theirs"}


def test_two_bakes_of_one_name_in_two_layouts_do_not_meet(tmp_path):
    path = tmp_path / "o.usdc"

    def second() -> None:
        with pytest.raises(OutputError, match="another bake is writing this cache"):
            bake(path, layout="clips")

    bake(path, before_end=second, layout="flat")
    assert set(tree(tmp_path)) == {"o.usdc"}


def test_what_is_published_before_the_lock_is_had_is_seen_before_any_work(tmp_path, monkeypatch):
    path = tmp_path / "o.usdc"

    def late(*given, **more):
        path.write_text("theirs")
        return unfinished_cache.Parts(*given, **more)

    monkeypatch.setattr("featherfx.usd.write.cache_writer.Parts", late)
    with pytest.raises(OutputError, match=r"o\.usdc: another bake has just written it"):
        CacheWriter(path, feathers.entries(), (1, 3))
    assert tree(tmp_path) == {"o.usdc": b"theirs"}


def test_a_payload_of_others_is_not_replaced_where_the_layout_is_chosen(tmp_path, monkeypatch):
    monkeypatch.setattr("featherfx.usd.write.output._MAX_FLAT_BYTES", 1)
    other = tmp_path / "o.payload.usdc"
    other.write_text("mine")
    for resume in (False, True):
        with pytest.raises(OutputError, match=r"o\.payload\.usdc: exists already"):
            bake(tmp_path / "o.usdc", layout="auto", resume=resume)
    assert tree(tmp_path) == {"o.payload.usdc": b"mine"}


@pytest.mark.skipif(os.name == "nt", reason="no named pipes in folders")
def test_an_output_is_a_regular_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.usdc")
    (tmp_path / "null.usdc").symlink_to("/dev/null")
    for name in ("pipe.usdc", "null.usdc"):
        with pytest.raises(InputError, match="is no regular file"):
            check_output(tmp_path / name, overwrite=True)
    with pytest.raises(InputError, match="backslash in its name"):
        check_output(tmp_path / "a\\b.usdc")


@pytest.mark.skipif(os.name == "nt", reason="no named pipes in folders")
def test_a_report_replaces_only_what_it_may(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "mine.json").write_text('{"mine": 1}')
    (tmp_path / "report.json").write_text('{"shot": "", "samples": 1, "samples_taken_over": 0}')
    shot = SAMPLES / "feather_pull/shot.toml"

    def prepared(name: str, **options) -> None:
        prepare(shot, tmp_path / "o.usdc", BakeOptions(report=tmp_path / name, **options))

    for options in ({}, {"overwrite": True}):
        with pytest.raises(InputError, match=r"pipe\.json: is no regular file"):
            prepared("pipe.json", **options)
    for name, options in (("report", {}), ("mine", {}), ("mine", {"resume": True})):
        with pytest.raises(InputError, match=rf"{name}\.json: exists already"):
            prepared(f"{name}.json", **options)
    prepared("mine.json", overwrite=True)
    prepared("report.json", resume=True)
    prepared("new.json")


def test_a_lock_of_others_stays(tmp_path):
    (tmp_path / ".o.usdc.lock").write_text("mine")
    with pytest.raises(OutputError, match=r"\.o\.usdc\.lock: is no lock of this program"):
        bake(tmp_path / "o.usdc")
    assert tree(tmp_path) == {".o.usdc.lock": b"mine"}


def test_an_interrupt_among_renames_waits_for_the_last(tmp_path, monkeypatch):
    """All files of a set are new, and the message does not say that nothing was written."""
    path = tmp_path / "o.usda"
    bake(path, layout="payload")
    before = tree(tmp_path)
    real = os.replace

    def replace(source, target):
        real(source, target)
        if Path(target).name == "o.payload.usdc":
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(atomic_write.os, "replace", replace)
    with pytest.raises(KeyboardInterrupt, match=r"interrupted, but .*o\.usda is complete"):
        bake(path, layout="payload", overwrite=True, meters_per_unit=0.01)
    after = tree(tmp_path)
    assert set(after) == set(before)
    assert all(after[name] != before[name] for name in before)


@pytest.mark.parametrize("layout", ["clips", "flat", "payload"])
@pytest.mark.parametrize("gone", ["output", "chunks"])
@pytest.mark.parametrize("when", ["early", "late"])
@pytest.mark.parametrize("made_again", [False, True])
def test_a_folder_that_is_removed_in_mid_bake_is_one_message(
    tmp_path, layout, gone, when, made_again
):
    path = tmp_path / "out" / "o.usdc"
    path.parent.mkdir()
    own = {"output": path.parent, "chunks": parts_folder(path, layout)}[gone]

    def run() -> None:
        options = WriteOptions(chunk=1, layout=layout)
        with CacheWriter(path, feathers.entries(), (1, 3), options=options) as writer:
            for number in (1, 2, 3):
                writer.write(feathers.frame(number))
                if number == {"early": 1, "late": 3}[when]:
                    assert writer.samples_done == number
                    shutil.rmtree(own)
                    if made_again:
                        own.mkdir()

    with pytest.raises(OutputError) as caught:
        run()
    assert len(caught.value.problems) == 1
    assert [each for each in tmp_path.rglob("*") if each.is_file()] == []
