"""`featherfx view`, `tune` and `preview`: pages in a browser, and pictures of caches."""

from __future__ import annotations

import contextlib
import tempfile
import webbrowser
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from featherfx.baking import pipeline
from featherfx.cli.options import (
    FRAMES,
    RealNumber,
    WholeNumber,
    default_jobs,
    jobs_option,
    options_of,
    output_option,
    overwrite_option,
    presets_option,
    progress_option,
    readable_path,
    serving_options,
)
from featherfx.cli.program import Command, tell
from featherfx.cli.progress import Progress
from featherfx.limits import MAX_SHEET
from featherfx.render.options import PictureOptions

if TYPE_CHECKING:
    from featherfx.view.page import Server


_QUALITY = "draft"


@click.command(
    cls=Command,
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
    "--value",
    "values",
    type=click.Choice(["strain", "hooked", "penetration"]),
    multiple=True,
    help="Of --html: a value to colour by that changes with frames, which takes most of the time."
    " Repeatable.  [default: none]",
)
@click.option(
    "--megabytes",
    type=RealNumber(0.1, 10_000.0),
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
    values: tuple[str, ...],
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
    if html is not None and (serving["port"] or serving["no_browser"]):
        raise click.UsageError("--port and --no-browser are for a page that is served, not --html")
    if html is None and values:
        raise click.UsageError("--value is for --html. A page that is served has all of them")
    budget = int(1e6 * megabytes)
    with contextlib.ExitStack() as stack:
        with Progress("drawing", style):
            caches = [stack.enter_context(_cache_of(file, quality or _QUALITY))]
            caches += [against] if against else []
            # reads USD and draws, which takes its time to load
            from featherfx.view.page import Server, fitting_second, write_page

            if html is not None:
                shown = write_page(caches, html, budget, overwrite, values)
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
    with server, contextlib.suppress(KeyboardInterrupt):
        click.echo(server.address)
        if not no_browser and not webbrowser.open(server.address):
            tell("no browser was found; open the address above in one of this machine")
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


# what is simulated where a preset is given: one feather of it, or of this kind
_KIND, _WIND, _MOTION = "swan_primary", "breeze", "hold"
_FAMILIES = ("feather", "material/vane", "material/rachis", "wind", "motion", "wing")
# of a wing that is tuned by itself, which has some two hundred feathers with its coverts
_OF_WING = "wing_primary_*"


@click.command(
    cls=Command,
    epilog="""
    featherfx tune swan_primary
    featherfx tune wing/pigeon --motion flap
    featherfx tune samples/breeze/shot.toml --feather 'right_primary_0?' --into my_presets
    featherfx bake samples/breeze/shot.toml -o breeze.usdc --presets my_presets
    """,
)
@click.argument("what", metavar="SHOT|PRESET")
@click.option(
    "--feather",
    "feathers",
    multiple=True,
    metavar="ID",
    help="Show only these feathers of a shot or wing; * and ? are wild cards. Repeatable."
    f"  [default: all of a shot, {_OF_WING} of a wing]",
)
@click.option(
    "--into",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("tuned_presets"),
    show_default=True,
    metavar="FOLDER",
    help="Folder of presets that `save` writes into.",
)
@click.option(
    "--wind", metavar="NAME", help=f"Wind in which a preset is shown.  [default: {_WIND}]"
)
@click.option(
    "--motion", metavar="NAME", help=f"Motion in which a preset is shown.  [default: {_MOTION}]"
)
@click.option(
    "--quality", metavar="NAME", default="draft", show_default=True, help="Quality preset."
)
@presets_option
@serving_options
@overwrite_option("`save` may replace presets in the folder.")
def tune(
    what: str,
    feathers: Sequence[str],
    into: Path,
    wind: str | None,
    motion: str | None,
    quality: str,
    preset_folders: Sequence[Path],
    overwrite: bool,
    **serving: Any,
) -> None:
    """Simulate a SHOT (TOML), or one feather or wing of a PRESET, while you move sliders.

    In the page: drag a feather to pull it; drag beside it, or anywhere with shift, to turn the
    view; hold b to blow along the view. `save` writes presets that hold only what you changed; give
    their folder to `bake --presets`. The address works on this machine only and holds a secret
    token; the server writes nothing but these presets. Ctrl-C ends it.
    """
    # simulates and draws, which takes its time to load
    from featherfx.view.live import Live, LiveServer, LiveSource, presets_of

    shot = Path(what)
    given = shot.suffix == ".toml"
    if given and (wind or motion):
        raise click.UsageError("--wind and --motion are for presets. A shot has its own")
    with tempfile.TemporaryDirectory(prefix="featherfx-") as name:
        folder = Path(name)
        if not given:
            shot, family = _stage(what, folder, preset_folders, wind or _WIND, motion or _MOTION)
            if feathers and family != "wing":
                raise click.UsageError("--feather is for shots and wings")
            feathers = feathers or [_OF_WING] * (family == "wing")
        source = LiveSource(shot, folder, feathers, quality, preset_folders, default_jobs())
        with Live(source, presets_of(source)) as live:
            server = LiveServer(live, into, overwrite, serving["port"] or 0)
            serve(server, serving["no_browser"])


def _stage(
    preset: str, folder: Path, folders: Sequence[Path], wind: str, motion: str
) -> tuple[Path, str]:
    """A shot of one feather, or of a wing, that a preset is of, and the preset's family."""
    from featherfx.errors import InputError, Problem
    from featherfx.groom.presets.presets import load_preset
    from featherfx.groom.read.toml_text import toml_of

    for each in (f"wind/{wind}", f"motion/{motion}"):
        load_preset(each, folders)
    family, _ = load_preset(preset, folders)
    name = preset.rpartition("/")[2]
    if family not in _FAMILIES:
        told = f"is a {family} preset. Give one of {', '.join(_FAMILIES)}"
        if family == "bird":
            told += (
                ". A bird needs a body, so give a shot that has one (featherfx sample first_bird)"
            )
        raise InputError(Problem("tune", preset, told))
    feather = {"id": "feather", "kind": name if family == "feather" else _KIND}
    own = {"wind": wind, "motion": motion} | (
        {family: name} if family in ("wind", "motion") else {}
    )
    lines = ['name = "groom"', "[[feather]]", "position = [0, 0, 0]"]
    lines += [f"{key} = {toml_of(value)}" for key, value in feather.items()]
    if family.startswith("material/"):
        lines.append(f"overrides = {{ {family[9:]}_material = {toml_of(name)} }}")
    if family == "wing":
        own_wing = {"id": "wing", "type": name, "shoulder": [0, 0, 0], "fold": 0}
        lines = ['name = "groom"', "[[wing]]"]
        lines += [f"{key} = {toml_of(value)}" for key, value in own_wing.items()]
    (folder / "groom.toml").write_text("\n".join(lines), encoding="utf-8")
    shot = {"name": name, "groom": "groom.toml", "frames": [1, 2], **own}
    text = "\n".join(f"{key} = {toml_of(value)}" for key, value in shot.items())
    (folder / "shot.toml").write_text(text, encoding="utf-8")
    return folder / "shot.toml", family


@click.command(
    cls=Command,
    epilog="""
    featherfx preview swan_wing.usdc -o wing.png --frame 12
    featherfx preview swan_wing.usdc -o beat.png --sheet 8 --view front
    featherfx preview swan_wing.usdc -o one.png --feather right_primary_03 --frame 12
    featherfx preview new.usdc -o both.png --against old.usdc --frame 12
    featherfx preview wing.usda -o shot.mp4 --camera /cameras/main --frames 1-24
    featherfx preview swan_wing.usdc -o strain.png --frame 12 --colour strain --size 1920x1080
    """,
)
@click.argument("file", type=readable_path())
@output_option("File to write: .png, or a film as .gif or .mp4.")
@click.option(
    "--frame",
    "single",
    type=float,
    multiple=True,
    metavar="N",
    help="Frame to draw; repeat it for several files, or for the frames of a sheet.",
)
@click.option("--frames", "span", type=FRAMES, help="First and last frame to draw.")
@click.option(
    "--sheet",
    type=WholeNumber(1, MAX_SHEET),
    metavar="N",
    help="Contact sheet of N frames spread over the file, or of those of --frame.",
)
@click.option(
    "--turntable",
    type=WholeNumber(1, MAX_SHEET),
    metavar="N",
    help="N views around the upright axis.",
)
@options_of(
    PictureOptions,
    *("colour", "size", "view", "framing", "camera", "feathers", "regions", "surroundings"),
    *("against", "scenery", "bare", "floor", "samples", "rate"),
)
@click.option(
    "--f-stop", type=float, default=0.0, metavar="N", help="Blur of a lens, such as 2.8; 0: none."
)
@jobs_option("Threads that draw.")
@progress_option
@overwrite_option()
def preview(
    file: Path,
    output: Path,
    single: tuple[float, ...],
    span: tuple[int, int] | None,
    sheet: int | None,
    turntable: int | None,
    samples: str,
    style: str,
    **options: Any,
) -> None:
    """Draw the feathers of FILE (USD), without a screen or a GPU.

    Skin and colliders of the shot are drawn with them. The camera is the same for all frames and
    all calls on one file. Needs the extra `preview`: pip install "featherfx[preview]"; films as
    .mp4 need `film`.
    """
    frames = _frames(file, single, span, None if turntable else sheet)

    from featherfx.render.picture import render

    with Progress("drawing", style):
        written = render(
            file,
            output,
            frames=frames,
            sheet=bool(sheet),
            turntable=turntable or 0,
            samples=int(samples),
            **options,
        )
    for path in written:
        click.echo(str(path), err=True)


def _frames(
    file: Path, single: tuple[float, ...], span: tuple[int, int] | None, sheet: int | None
) -> list[float] | None:
    """The frames that the options name; None leaves them open."""
    if single and span:
        raise click.UsageError("--frame and --frames exclude each other")
    if span:
        frames = [float(frame) for frame in range(span[0], min(span[1], span[0] + 10**5) + 1)]
    else:
        frames = list(single)
    if sheet and frames and len(frames) != sheet:
        told = "--frames" if span else f"{len(frames)} times --frame"
        raise click.UsageError(f"--sheet {sheet} and {told} do not agree")
    return frames or (_spread(file, sheet) if sheet else None)


def _spread(file: Path, count: int) -> list[float] | None:
    """Up to count frames spread over a file; None for one without frames."""
    from featherfx.usd.read.cache import Cache

    cache = Cache(file)
    if not cache.has_frames:
        return None
    first, last = cache.frames
    steps = min(count, int(last - first) + 1)
    return [first + round(k * (last - first) / max(steps - 1, 1)) for k in range(steps)]
