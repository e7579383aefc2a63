"""`featherfx lab traction | locking | mesoscale | calibrate | angles`: samples of a vane."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from featherfx.cli.lab.common import json_option, options
from featherfx.cli.options import readable_path
from featherfx.cli.program import Command

if TYPE_CHECKING:
    from featherfx.lab.studies.study import Figure
    from featherfx.lab.vane.mesoscale import Bands

picture_option = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture (PNG); needs matplotlib, the extra `plots`.",
)
moduli_options = options(
    click.option("--along", type=float, default=3.6e8, show_default=True, help="Pa."),
    click.option("--across", type=float, default=4.8e4, show_default=True, help="Pa."),
    click.option("--shear", type=float, default=2.8e4, show_default=True, help="Pa."),
)
band_options = options(
    click.option(
        "--barb-fraction", type=float, default=0.14, show_default=True, help="Share of the surface."
    ),
    click.option("--barb-spacing", type=float, default=5e-4, show_default=True, help="m."),
    click.option("--barb", type=float, help="Pa.  [default: fitted to 3.6e8 Pa along the barbs]"),
    click.option("--barbule", type=float, help="Pa.  [default: fitted to 4.8e4 Pa across them]"),
)


@click.command(
    cls=Command,
    short_help="Pull a rectangular sample of a vane.",
    epilog="""
    featherfx lab traction --angle 45 --width 0.013 --height 0.018
    featherfx lab traction --angle 30 --width 0.013 --height 0.018 --model inextensible --json
    """,
)
@click.option("--angle", type=float, required=True, help="Degrees from the x axis to the barbs.")
@click.option("--width", type=float, required=True, help="m.")
@click.option("--height", type=float, required=True, help="m, between the clamps.")
@click.option("--thickness", type=float, default=1.2e-4, show_default=True, help="m.")
@moduli_options
@click.option("--strain", type=float, default=0.05, show_default=True, help="Largest, along y.")
@click.option("--steps", type=int, default=10, show_default=True, help="Equal steps of strain.")
@click.option("--elements", type=int, default=8000, show_default=True, help="Triangles, about.")
@click.option("--mesh", type=click.Choice(["aligned", "unaligned"]), default="aligned")
@click.option(
    "--model",
    type=click.Choice(["shell", "inextensible", "isotropic"]),
    default="shell",
    show_default=True,
    help="All three moduli; barbs of constant length; the modulus across for all directions.",
)
@picture_option
@json_option
def traction(output: Path | None, as_json: bool, **values: Any) -> None:
    """Clamp a sample below and above and pull it along y.

    0 degrees is the transverse test, 90 the longitudinal, 45 the tilted one. Where barbs join both
    clamps `regime` and `note` say so; a number that depends on the mesh is not given.
    """
    from featherfx.lab.vane.pictures import traction_picture
    from featherfx.lab.vane.sample import Moduli, Sample
    from featherfx.lab.vane.traction import Traction, run_traction

    sample = Sample(*(values.pop(key) for key in ("angle", "width", "height", "thickness")))
    moduli = Moduli(*(values.pop(key) for key in ("along", "across", "shear")))
    result = run_traction(Traction(sample, moduli, **values))
    _finish(result.as_json(), as_json, output, lambda file: traction_picture(file, result))


@click.command(
    cls=Command,
    short_help="Error of a tilted test against elements, for ratios of the moduli.",
    epilog="featherfx lab locking -o locking.png\nfeatherfx lab locking --ratio 1e4 --json",
)
@click.option("--ratio", "ratios", type=float, multiple=True, help="Repeatable. [1, 1e2, 1e4, 1e6]")
@click.option("--elements", type=int, multiple=True, help="Repeatable. [128, 512, 2048, 8192]")
@picture_option
@json_option
def locking(
    ratios: tuple[float, ...], elements: tuple[int, ...], output: Path | None, as_json: bool
) -> None:
    """Aligned and unaligned meshes at 45 degrees and 5 % strain, 13 by 18 mm."""
    from featherfx.lab.vane import locking as study
    from featherfx.lab.vane.pictures import locking_picture

    result = study.run_locking(ratios or study.RATIOS, elements or study.ELEMENTS)
    _finish(result.as_json(), as_json, output, lambda file: locking_picture(file, result))


@click.command(
    cls=Command,
    short_help="Barbs as stiff bands, barbules as soft ones.",
    epilog="""
    featherfx lab mesoscale --barb-fraction 0.14
    featherfx lab mesoscale --angle 45 --strain 0.1 --json
    featherfx lab mesoscale --size-effect -o size.png
    """,
)
@band_options
@click.option("--angle", type=float, default=0.0, show_default=True, help="Degrees.")
@click.option("--width", type=float, default=13e-3, show_default=True, help="m.")
@click.option("--height", type=float, default=16.9e-3, show_default=True, help="m.")
@click.option("--strain", type=float, default=0.05, show_default=True, help="Largest, along y.")
@click.option("--steps", type=int, default=4, show_default=True, help="Equal steps of strain.")
@click.option("--size-effect", is_flag=True, help="Press along the barbs instead, for four widths.")
@picture_option
@json_option
def mesoscale(
    size_effect: bool, output: Path | None, as_json: bool, strain: float, steps: int, **values: Any
) -> None:
    """Pull a sample of bands; at 0 and 90 degrees beside the closed forms.

    At 0 and 90 degrees the sample is rounded to whole barb spacings.
    """
    from featherfx.lab.vane.mesoscale import BandTest, run_bands
    from featherfx.lab.vane.pictures import size_picture
    from featherfx.lab.vane.sample import Sample
    from featherfx.lab.vane.size_effect import run_size_effect

    bands = _bands(values)
    if size_effect:
        sizes = run_size_effect(fraction=bands.barb_fraction)
        _finish(sizes.as_json(), as_json, output, lambda file: size_picture(file, sizes))
        return
    if output is not None:
        raise click.UsageError("-o belongs to --size-effect")
    sample = Sample(*(values[key] for key in ("angle", "width", "height")))
    _finish(run_bands(BandTest(sample, bands, strain, steps)), as_json)


@click.command(
    cls=Command,
    short_help="Moduli of a vane from stress-strain curves.",
    epilog="""
    featherfx lab calibrate tests.csv --json
    featherfx lab calibrate tests.csv --save mine --name my_vane
    """,
)
@click.argument("file", type=readable_path())
@click.option("--elements", type=int, default=8000, show_default=True, help="Of tilted samples.")
@click.option(
    "--save",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Save as a material preset in this folder of presets.",
)
@click.option("--name", help="Of the preset.")
@json_option
def calibrate(
    file: Path, elements: int, save: Path | None, name: str | None, as_json: bool
) -> None:
    """Fit the three moduli to FILE, a CSV with the columns strain, stress (Pa), angle (degrees),
    width, height and thickness (m), one point a line.

    Curves that cannot determine a modulus are refused, with the test that is missing.
    """
    if (save is None) != (name is None):
        raise click.UsageError("--save and --name belong together")
    from featherfx.lab.vane.calibrate import calibrate as fit
    from featherfx.lab.vane.curves import read_curves
    from featherfx.lab.vane.preset import check_name, save_preset

    if save is not None and name is not None:
        check_name(save, name)
    curves = read_curves(file)
    found = fit(curves, elements, str(file))
    _finish(found.as_json(), as_json)
    if save is not None and name is not None:
        thickness = sum(curve.sample.thickness for curve in curves) / len(curves)
        click.echo(save_preset(save, name, found, thickness), err=as_json)


@click.command(
    cls=Command,
    short_help="Membrane beside bands at all angles, and the shear band.",
    epilog="featherfx lab angles -o angles.png --pictures bands.png",
)
@band_options
@click.option("--angle", "angles", type=float, multiple=True, help="Repeatable. [0, 15, 30, 45]")
@click.option("--aspect", "aspects", type=float, multiple=True, help="Repeatable. [1.2, 1.6, 2.2]")
@click.option(
    "--pictures",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture of the shear bands, both models side by side.",
)
@picture_option
@json_option
def angles(
    angles: tuple[float, ...],
    aspects: tuple[float, ...],
    pictures: Path | None,
    output: Path | None,
    as_json: bool,
    **values: Any,
) -> None:
    """Fit the membrane's shear modulus to bands at 45 degrees; compare at other angles."""
    from featherfx.lab.vane import angles as study
    from featherfx.lab.vane.pictures import angles_picture, band_picture

    bands = _bands(values)
    slopes = study.angle_slopes(bands, angles or study.ANGLES)
    found = study.shear_bands(bands, slopes.fitted.moduli, aspects or study.ASPECTS)
    if pictures is not None:
        _wrote(band_picture(pictures, found), as_json)
    keys = {**slopes.as_json(), "shear_bands": [each.as_json() for each in found]}
    _finish(keys, as_json, output, lambda file: angles_picture(file, slopes, bands.barbule))


def _bands(values: dict[str, Any]) -> Bands:
    """The bands of the options; moduli that are not given are those of the swan."""
    from featherfx.lab.vane.mesoscale import swan_bands

    keys = ("barb_fraction", "barb_spacing", "barb", "barbule")
    return swan_bands(*(values[key] for key in keys))


def _finish(
    values: dict[str, Any],
    as_json: bool,
    output: Path | None = None,
    picture: Callable[[Path], tuple[Figure, ...]] | None = None,
) -> None:
    if as_json:
        click.echo(json.dumps(values))
    else:
        for line in _lines(values, ""):
            click.echo(line)
    if output is not None and picture is not None:
        _wrote(picture(output), as_json)


def _wrote(figures: tuple[Figure, ...], quiet: bool) -> None:
    if not figures:
        click.echo("featherfx: no picture, matplotlib is not installed", err=True)
    for figure in figures:
        click.echo(figure.file, err=quiet)


def _lines(values: dict[str, Any], before: str) -> Iterator[str]:
    """A table: names and values, tables in tables by dotted names."""
    for key, value in values.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            yield from _lines(value, f"{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield name
            for row in value:
                yield "  " + "  ".join(f"{k} {_text(v)}" for k, v in row.items())
        elif isinstance(value, list):
            yield f"{name:24} " + "  ".join(_text(each) for each in value)
        else:
            yield f"{name:24} {_text(value)}"


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return "[" + " ".join(_text(each) for each in value) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
