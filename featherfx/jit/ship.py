"""Fills featherfx/_machine_code, which a wheel that is built afterwards holds.

python -m featherfx.jit.ship

compiles what samples of the common works need, for what most processors of this machine's family
have in common; shipped.py says when it is used. A wheel may hold the folders that several machines
and Pythons have filled.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from featherfx.jit.cache import ROOT
from featherfx.jit.shipped import FOLDER, Processor, of_this_machine

_SAMPLES = ROOT.parent / "samples"
# what compiles what is common: steps of a wing, feathers that touch, the layout of a bird
_FRAMES = ("--quality", "draft", "--frames", "1-2", "-o")
WORKS = (
    ("bake", _SAMPLES / "swan_wing" / "shot.toml", *_FRAMES),
    ("bake", _SAMPLES / "flapping_bird" / "shot.toml", *_FRAMES),
    ("groom", _SAMPLES / "pigeon" / "groom.toml", "--quality", "draft", "-o"),
)


def fill(folder: Path, processor: Processor) -> None:
    """Compile for a processor into an empty folder."""
    with tempfile.TemporaryDirectory() as place:
        environment = os.environ | {
            "FEATHERFX_CACHE": str(folder),
            "NUMBA_CPU_NAME": processor.name,
            "NUMBA_CPU_FEATURES": "",
        }
        for number, work in enumerate(WORKS):
            command = [sys.executable, "-m", "featherfx", *map(str, work)]
            subprocess.run([*command, Path(place) / f"{number}.usdc"], env=environment, check=True)


def main() -> None:
    """Fill the folder anew."""
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
    main()
