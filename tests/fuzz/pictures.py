"""Damaged photographs: bytes of pictures, their modes and sizes, and odd options of `trace`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from .cases import Command, Kind

Random = np.random.Generator
NAMES = ("photo.png", "photo.jpg", "photo.tif", "photo.webp")
MODES = ("1", "L", "P", "RGB", "RGBA", "CMYK", "I;16", "I", "F", "LA")
SHAFTS = ("nan,nan", "inf,0 1,1", "1,1", "-5,-5 1e9,1e9", "20,20 20,20", "x", "20,110 60,20", "")
LENGTHS = ("nan", "inf", "0", "-1", "1e-300", "0.2")


def prepare(folder: Path) -> None:
    """A feather on a plain ground, in several formats."""
    picture = Image.new("RGB", (120, 300), (240, 240, 235))
    draw = ImageDraw.Draw(picture)
    along = np.linspace(0.0, 1.0, 60)
    half, row = np.sin(np.pi * along**0.6) ** 0.6, 240.0 - 220.0 * along
    left, right = np.stack([60.0 - 14.0 * half, row], 1), np.stack([60.0 + 26.0 * half, row], 1)
    draw.polygon([tuple(place) for place in (*left, *right[::-1])], fill=(110, 100, 90))
    draw.line((60, 285, 60, 24), fill=(40, 30, 25), width=3)
    for name in NAMES:
        picture.save(folder / name)


def damage(random: Random, number: int, folder: Path) -> tuple[str, Sequence[Command]]:
    """One picture in another mode or size, or with other bytes, and odd options."""
    file = folder / NAMES[number % len(NAMES)]
    how = ("bytes", "cut", "mode", "size", "sound")[random.integers(5)]
    if how == "bytes":
        data = bytearray(file.read_bytes())
        for place in random.integers(0, len(data), random.integers(1, 9)):
            data[place] = random.integers(256)
        file.write_bytes(bytes(data))
    elif how == "cut":
        file.write_bytes(file.read_bytes()[: random.integers(file.stat().st_size)])
    elif how == "mode":
        file = folder / ("photo.tif" if random.random() < 0.5 else "photo.png")
        mode = MODES[random.integers(len(MODES))]
        try:
            Image.open(folder / "photo.png").convert("L").convert(mode).save(file)
        except (ValueError, OSError):
            how = f"mode {mode} that nobody writes"
    elif how == "size":
        size = [int(each) for each in 10.0 ** random.uniform(0.0, 2.5, 2)]
        Image.open(folder / "photo.png").resize(size).save(folder / "photo.png")
        file = folder / "photo.png"
    options = ["trace", file.name, "-o", "own.toml"]
    if random.random() < 0.3:
        options += ["--shaft", SHAFTS[random.integers(len(SHAFTS))]]
    if random.random() < 0.2:
        options += ["--length", LENGTHS[random.integers(len(LENGTHS))]]
    if random.random() < 0.3:
        options += ["--overlay", "over.png"]
    return f"{file.name}: {how}", [Command(tuple(options), ("own.toml", "over.png"))]


KIND = Kind(prepare, damage, ("featherfx.trace.trace",))
