"""Finished pictures to files: PNG, GIF, and MP4 by an encoder that is an extra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import Standing, write_all

Picture = NDArray[np.uint8]


def save(pictures: Sequence[Picture], before: Mapping[Path, Standing], rate: float) -> None:
    """Write files, all or none.

    before: what stood at each when the work began; one of them, unless it is as many PNG files as
    there are pictures. rate: pictures a second of a film. Raises InputError where the system
    refuses.
    """
    files = list(before)
    suffix = files[0].suffix.lower()
    if suffix == ".png":
        each = [(f, partial(_png, picture=p)) for f, p in zip(files, pictures, strict=True)]
    else:
        film = partial(_gif if suffix == ".gif" else _mp4, pictures=pictures, rate=rate)
        each = [(files[0], film)]
    try:
        write_all(each, before)
    except OSError as error:
        message = f"cannot be written: {error.strerror or error}"
        raise InputError(Problem(str(error.filename or files[0]), "", message)) from error


def _png(path: Path, picture: Picture) -> None:
    Image.fromarray(picture).save(path, format="PNG", optimize=True)


def _gif(path: Path, pictures: Sequence[Picture], rate: float) -> None:
    # one palette for all, else colours flicker
    middle = Image.fromarray(pictures[len(pictures) // 2])
    palette = middle.quantize(256, dither=Image.Dither.NONE)
    images = [Image.fromarray(each).quantize(palette=palette) for each in pictures]
    # GIF counts in hundredths of a second
    lasting = max(round(100 / rate), 2) * 10
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:], duration=lasting, loop=0
    )


def _mp4(path: Path, pictures: Sequence[Picture], rate: float) -> None:
    import imageio_ffmpeg

    # the encoder takes even sides
    height, width = (side - side % 2 for side in pictures[0].shape[:2])
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=rate, codec="libx264", quality=8,
        macro_block_size=2, output_params=["-f", "mp4"], ffmpeg_log_level="error",
    )  # fmt: skip
    writer.send(None)
    try:
        for each in pictures:
            writer.send(np.ascontiguousarray(each[:height, :width]))
    finally:
        writer.close()
