"""The page as one HTML text: with all frames in it, or with frames that a server gives it."""

from __future__ import annotations

import base64
import gzip
import html
import secrets
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from featherfx.files.atomic_write import into, standing, write_all
from featherfx.phases import counted
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import find_file_problems
from featherfx.view.played import Played, packed

_FOLDER = Path(__file__).parent
_SCRIPTS = ("software.js", "shown.js", "page.js")
_ALL = 1 << 62  # points
_KEPT_BYTES = 400_000_000  # of frames that a page keeps in memory
# of the names of what belongs to one and another cache
PREFIXES = ("", "second-")


def header_of(first: Played, second: Played | None = None) -> dict[str, Any]:
    """Describe a cache, or two that are compared, for the viewer. alike: points of one are those
    of the other."""
    header = first.header()
    if second is not None:
        header["second"] = second.header() | {"keptBytes": _KEPT_BYTES}
        header["alike"] = first.constant_shape == second.constant_shape
        told = [header["told"], header["second"]["told"]]
        if not header["alike"]:
            told.append("other feathers or another resolution, so there is no difference")
        header["told"] = "; ".join(filter(None, told))
    return header


def page(
    header: dict[str, Any], title: str, data: Iterator[tuple[str, bytes]] | None = None
) -> Iterator[str]:
    """A page, piece by piece. data: names and contents of what is in it; None: it asks its
    server."""
    nonce = secrets.token_urlsafe(16)
    header = header | {"embedded": data is not None, "keptBytes": _KEPT_BYTES}
    values = {
        "NONCE": nonce,
        "CONNECT": "'none'" if data is not None else "'self'",
        "TITLE": html.escape(title),
        "HEADER": packed(header),
        "THREE": _text("three.min.js"),
        "SCRIPT": "".join(_text(name) for name in [*["live.js"] * ("live" in header), *_SCRIPTS]),
    }
    before, after = _text("page.html").split("@DATA@")
    yield _filled(before, values)
    for name, content in data or ():
        text = base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()
        yield f'<script nonce="{nonce}" type="text/plain" id="data-{name}">{text}</script>\n'
    yield _filled(after, values)


def write_page(
    paths: Sequence[Path], output: str | Path, most_bytes: int, overwrite: bool
) -> list[Played]:
    """Write a cache as one HTML file that loads nothing else; it appears complete or not at all.

    paths: of one cache, or of two that are compared. most_bytes: of frames, before they are packed;
    points, then frames are left out to keep it.
    Raises InputError where the cache cannot be read or the output not be written.
    """
    output = Path(output)
    problems = find_file_problems([output], overwrite)
    if problems:
        raise OutputError(*problems)
    before = {output: standing(output)}
    shown = [fitting(each, most_bytes // len(paths)) for each in paths]

    def data() -> Iterator[tuple[str, bytes]]:
        for played, prefix in zip(shown, PREFIXES, strict=False):
            constants, frames = played.names()
            for names in chain([constants], counted("drawing", frames, len(frames))):
                for name in names:
                    yield f"{prefix}{name}", played.content(name) or b""

    pieces = page(header_of(*shown), shown[0].path.name, data())
    write_all([(output, into(lambda file: file.writelines(map(str.encode, pieces))))], before)
    return shown


def fitting(path: Path, most_bytes: int) -> Played:
    """A cache with as many points, then frames, as fit into bytes."""
    whole = Played(path, _ALL)
    count = len(whole.codes)
    thin = _within(whole, most_bytes / count)
    if count * thin.frame_bytes <= most_bytes:
        return thin
    return Played(path, 1, max(int(most_bytes / thin.frame_bytes), 1), thin.bare)


def fitting_second(path: Path, most_bytes: int) -> Played:
    """A cache with as many points as a second of it has in bytes."""
    whole = Played(path, _ALL)
    if len(whole.codes) == 1:
        return whole
    return _within(whole, most_bytes / whole.frames_per_second)


def _within(whole: Played, most_bytes: float) -> Played:
    """A cache with as many points as fit into bytes a frame; without the body where that takes more
    than half of them."""
    if whole.frame_bytes <= most_bytes:
        return whole
    bare = whole.body_bytes > 0.5 * most_bytes
    left = most_bytes - 24 - (0 if bare else whole.body_bytes)
    return Played(whole.path, max(int(left / whole.point_bytes), 1), bare=bare)


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _filled(text: str, values: dict[str, str]) -> str:
    parts = text.split("@")
    # names stand at odd places; what is filled in is not looked at again
    return "".join(part if k % 2 == 0 else values[part] for k, part in enumerate(parts))
