"""Fills featherfx/_machine_code, which a wheel that is built afterwards holds.

python .ci/ship.py compiles what samples of the common works need, for what most
processors of this machine's family have in common. A wheel may hold the folders that several
machines and Pythons have filled.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from featherfx.jit.code_cache import ROOT, SHIPPED, find_target

_SAMPLES = ROOT.parent / "samples"
_FRAMES = ("--quality", "draft", "--frames", "1-6", "-o")
# Commands that compile what is common. At once: steps of feathers that touch each other, and the
# layout and coat of a bird, which need different kernels; then a body that is touched, and free
# feathers, condensed. Caches of five frames and more are judged by their accelerations, too.
_WORKS = (
    (
        ("bake", _SAMPLES / "flapping_bird" / "shot.toml", *_FRAMES),
        ("bake", _SAMPLES / "pigeon" / "shot.toml", *_FRAMES),
    ),
    (
        ("bake", _SAMPLES / "torn_feather" / "shot.toml", *_FRAMES),
        ("bake", _SAMPLES / "swan_wing" / "shot.toml", "--as", "condensed", *_FRAMES),
    ),
)


def compile_works(folder: Path, processor: str) -> None:
    """Compile for a processor into an empty folder. Raises CalledProcessError."""
    variables = {
        "FEATHERFX_CACHE": str(folder),
        "NUMBA_CPU_NAME": processor,
        "NUMBA_CPU_FEATURES": "",
    }
    with tempfile.TemporaryDirectory() as place:
        for together in _WORKS:
            commands = []
            for work in together:
                output = str(Path(place) / f"{work[1].parent.name}.usdc")
                commands.append([sys.executable, "-m", "featherfx", *map(str, work), output])
            runs = [subprocess.Popen(each, env=os.environ | variables) for each in commands]
            for command, status in zip(commands, [run.wait() for run in runs], strict=True):
                if status:
                    raise subprocess.CalledProcessError(status, command)


def main() -> None:
    """Fill the folder anew."""
    shutil.rmtree(SHIPPED, ignore_errors=True)
    if not (processor := find_target()):
        raise SystemExit("No machine code is shipped for this processor.")
    with tempfile.TemporaryDirectory() as place:
        compile_works(Path(place), processor)
        entries = sorted(Path(place).glob("*/*.code"))
        for entry in entries:
            target = SHIPPED / entry.parent.name / entry.name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(entry, target)
        size = sum(each.stat().st_size for each in entries) / 1e6
    print(f"{processor}: {len(entries)} kernels, {size:.1f} MB")


if __name__ == "__main__":
    main()
