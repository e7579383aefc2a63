"""`featherfx lab unitcell`."""

from __future__ import annotations

from pathlib import Path

import click

from featherfx.cli.options import presets_option
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Moduli of a vane from its barbs and barbules.",
    epilog="""
    featherfx lab unitcell --preset swan_primary
    featherfx lab unitcell --preset swan_primary --angle 40 --diameter 12e-6 --hooks 4 --json
    featherfx lab unitcell --preset swan_primary --diameter 13e-6 --save my_vane.toml
    """,
)
@click.option("--preset", required=True, metavar="NAME", help="Feather preset.")
@click.option("--angle", type=float, default=45.0, show_default=True, help="deg, barbule to barb.")
@click.option(
    "--spacing", type=float, default=30e-6, show_default=True, help="m, of barbules along the barb."
)
@click.option("--diameter", type=float, default=5e-6, show_default=True, help="m, of a barbule.")
@click.option("--young", type=float, help="Pa, of the barbules.  [default: the rachis']")
@click.option("--hooks", type=int, default=3, show_default=True, help="Hooked crossings a barbule.")
@click.option(
    "--save",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="A material preset with these moduli; what the cell does not tell is the preset's.",
)
@presets_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object on the output, SI units.")
def unitcell(
    preset: str,
    angle: float,
    spacing: float,
    diameter: float,
    young: float | None,
    hooks: int,
    save: Path | None,
    preset_folders: tuple[Path, ...],
    as_json: bool,
) -> None:
    """A periodic lattice of barbs and hooked barbules, and the vane that it amounts to.

    Barbs are those of the preset: spacing, stretch and bending stiffness. `poisson` is the
    contraction along the barbs over the strain across them. `barbule_spacing` is that of the
    cell, for which a barbule spans a whole number of rows.
    """
    from featherfx.cli.lab.common import show
    from featherfx.lab.feathers.feather import feather_kind
    from featherfx.lab.networks.unit_cell import cell_moduli, cell_of, vane_of, vane_text

    kind = feather_kind(preset, preset_folders)
    values = {"angle": angle, "barbule_spacing": spacing, "barbule_diameter": diameter}
    if young is not None:
        values["young"] = young
    cell = cell_of(kind, **values, hooks=hooks)
    found = cell_moduli(cell)
    if save is not None:
        from featherfx.lab.studies.report import write_whole

        write_whole(save, vane_text(vane_of(cell, kind.vane_material), preset))
    show(
        {
            "along": found.along,
            "across": found.across,
            "shear": found.shear,
            "bending_along": found.bending_along,
            "bending_across": found.bending_across,
            "poisson": found.poisson,
            "crossings": 2 * cell.crossings - 1,
            "barbule_spacing": cell.height,
        },
        as_json,
    )
