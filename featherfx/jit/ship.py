"""Fills featherfx/_machine_code, which a wheel that is built afterwards holds.

python -m featherfx.jit.ship

compiles what samples of the common works need, for what most processors of this machine's family
have in common; shipped.py says when it is used. A wheel may hold the folders that several machines
and Pythons have filled.

python -m featherfx.jit.ship WHEEL

takes the machine code out of a wheel instead. A checkout of another version has use of all kernels
whose sources are those of the wheel, and compiles the others.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path, PurePosixPath
from zipfile import BadZipFile, ZipFile

from featherfx.jit.cache import ROOT
from featherfx.jit.shipped import FOLDER, Processor, of_this_machine

_SAMPLES = ROOT.parent / "samples"
# What compiles what is common. At once: steps of feathers that touch each other, and the layout of
# a bird, which need different kernels; then, with the same steps, a body that is touched, and
# feathers that are free.
_FRAMES = ("--quality", "draft", "--frames", "1-2", "-o")
WORKS = (
    (
        ("bake", _SAMPLES / "flapping_bird" / "shot.toml", *_FRAMES),
        ("groom", _SAMPLES / "pigeon" / "groom.toml", "--quality", "draft", "-o"),
    ),
    (
        ("bake", _SAMPLES / "torn_feather" / "shot.toml", *_FRAMES),
        ("bake", _SAMPLES / "swan_wing" / "shot.toml", *_FRAMES),
    ),
)


def fill(folder: Path, processor: Processor) -> None:
    """Compile for a processor into an empty folder."""
    with tempfile.TemporaryDirectory() as place:
        environment = os.environ | {
            "FEATHERFX_CACHE": str(folder),
            "NUMBA_CPU_NAME": processor.name,
            "NUMBA_CPU_FEATURES": "",
        }
        own = [sys.executable, "-m", "featherfx"]
        for together in WORKS:
            commands = [
                [*own, *map(str, work), str(Path(place) / f"{work[1].parent.name}.usdc")]
                for work in together
            ]
            works = [subprocess.Popen(each, env=environment) for each in commands]
            for command, ended in zip(commands, [work.wait() for work in works], strict=True):
                if ended:
                    raise subprocess.CalledProcessError(ended, command)


def take(wheel: Path) -> int:
    """Put the machine code of a wheel beside what is there; how many kernels came. Raises OSError
    and BadZipFile."""
    count = 0
    with ZipFile(wheel) as file:
        for name in map(PurePosixPath, file.namelist()):
            inside = name.parts[:2] == (ROOT.name, "_machine_code") and ".." not in name.parts
            if inside and name.suffix == ".code":
                target = FOLDER / name.parent.name / name.name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(file.read(str(name)))
                count += 1
    return count


def main(wheel: str = "") -> None:
    """Fill the folder anew, or take what a wheel holds."""
    if wheel:
        try:
            count = take(Path(wheel))
        except (OSError, BadZipFile) as error:
            raise SystemExit(f"{wheel}: {error}") from error
        if not count:
            raise SystemExit(f"{wheel}: holds no machine code")
        print(f"{count} kernels taken from {wheel}")
        return
    shutil.rmtree(FOLDER, ignore_errors=True)
    for processor in of_this_machine():
        with tempfile.TemporaryDirectory() as place:
            fill(Path(place), processor)
            entries = sorted(Path(place).glob("*/*.code"))
            for entry in entries:
                target = FOLDER / entry.parent.name / entry.name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(entry, target)
            size = sum(each.stat().st_size for each in entries) / 1e6
        print(f"{processor.name}: {len(entries)} kernels, {size:.1f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:2])
