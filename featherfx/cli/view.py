"""`featherfx view`: a cache, groom or shot in a browser."""

from __future__ import annotations

import contextlib
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from featherfx.baking import pipeline
from featherfx.cli.log import tell
from featherfx.cli.options import (
    default_jobs,
    overwrite_option,
    progress_option,
    readable_path,
    serving_options,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress

if TYPE_CHECKING:
    from featherfx.view.serve import Server

_QUALITY = "draft"


@click.command(
    cls=Command,
    short_help="Play a cache, groom or shot in a browser, or write it as one HTML file.",
    epilog="""
    featherfx view swan_wing.usdc
    featherfx view swan_wing.usdc --html swan_wing.html
    featherfx view new.usdc --against old.usdc
    featherfx view samples/breeze/shot.toml --html breeze.html --megabytes 20
    """,
)
@click.argument("file", metavar="CACHE|GROOM|SHOT", type=readable_path())
@click.option(
    "--against",
    type=readable_path(),
    metavar="CACHE",
    help="Show CACHE beside the file, in the same camera and frames, or colour by the distance"
    " between the two.",
)
@click.option(
    "--html",
    type=click.Path(path_type=Path),
    metavar="OUT.html",
    help="Write one file that loads nothing else, and open no browser.",
)
@click.option(
    "--megabytes",
    type=click.FloatRange(0.1, 10_000.0),
    default=64.0,
    show_default=True,
    help="Most data that the page gets: with --html all frames, before they are packed; else one"
    " second of frames. What is above is thinned out: points first, then frames. The page says so.",
)
@serving_options
@click.option(
    "--quality", metavar="NAME", help=f"Quality preset for a groom or shot.  [default: {_QUALITY}]"
)
@progress_option
@overwrite_option("Replace a file that exists.")
def view(
    file: Path,
    against: Path | None,
    html: Path | None,
    megabytes: float,
    quality: str | None,
    style: str,
    overwrite: bool,
    **serving: Any,
) -> None:
    """Play a CACHE (USD), show a GROOM at rest, or bake a SHOT (TOML) and play it.

    In the page: drag to turn, wheel to zoom, click to pick a feather, space to play, f to frame the
    picked feather, h to frame all. The address works on this machine only and holds a secret token;
    the server gives nothing but this cache. Ctrl-C ends it.
    """
    if quality and file.suffix != ".toml":
        raise click.UsageError("--quality is for grooms and shots")
    budget = int(1e6 * megabytes)
    with contextlib.ExitStack() as stack:
        with Progress("drawing", style):
            caches = [stack.enter_context(_cache_of(file, quality or _QUALITY))]
            caches += [against] if against else []
            # reads USD and draws, which takes its time to load
            from featherfx.view.page import fitting_second, write_page
            from featherfx.view.serve import Server

            if html is not None:
                shown = write_page(caches, html, budget, overwrite)
            else:
                shown = [fitting_second(each, budget // len(caches)) for each in caches]
        for told in dict.fromkeys(told for played in shown for told in played.told()):
            tell(told)
        if html is not None:
            click.echo(str(html))
        else:
            serve(Server(*shown, port=serving["port"] or 0), serving["no_browser"])


def serve(server: Server, no_browser: bool) -> None:
    """Show a page until Ctrl-C."""
    with server:
        click.echo(server.address)
        if not no_browser and not webbrowser.open(server.address):
            tell("no browser was found; open the address above in one of this machine")
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()


@contextlib.contextmanager
def _cache_of(file: Path, quality: str) -> Iterator[Path]:
    """A USD file of what is to be seen; of grooms and shots one that is removed afterwards."""
    if file.suffix != ".toml":
        yield file
        return
    from featherfx.groom.read.toml_file import load_toml

    keys = load_toml(file)
    with tempfile.TemporaryDirectory(prefix="featherfx-") as folder:
        cache = Path(folder) / f"{file.parent.name}_{file.stem}.usdc"
        if "groom" in keys:
            pipeline.bake(file, cache, quality=quality, jobs=default_jobs())
        else:
            pipeline.export_groom(file, cache, quality=quality, instances=False)
        yield cache
