"""The experiments of `featherfx lab`: what each runs, and what it writes besides its result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from featherfx.cli.lab.options_from import Experiment, command_from, report
from featherfx.cli.options import presets_option, readable_path
from featherfx.files.atomic_write import write_text
from featherfx.lab.contact import ContactTest, run_contact
from featherfx.lab.feather import (
    FallTest,
    FeatherTest,
    StreamTest,
    feather_kind,
    find_feather_modes,
    measure_fall,
    measure_stream,
    run_feather,
)
from featherfx.lab.full_feather import FullPull, pull_feather
from featherfx.lab.networks.experiments import (
    NetworkTest,
    PreconditionTest,
    network_moduli,
    precondition,
)
from featherfx.lab.networks.rupture import RuptureTest, run_rupture
from featherfx.lab.networks.unit_cell import (
    LAWS,
    CellTest,
    cell_moduli,
    fit_tissue,
    read_tissue,
    vane_of,
    vane_text,
)
from featherfx.lab.ribbons.experiments import HangTest, blown, hang
from featherfx.lab.ribbons.rod import (
    BendTest,
    ModesTest,
    ReleaseTest,
    bend,
    find_rod_modes,
    release,
)
from featherfx.lab.strip import PlateTest, StripTest, run_plate, run_strip
from featherfx.lab.vane.calibrate import (
    CalibrateTest,
    calibrate,
    check_name,
    read_curves,
    save_preset,
)
from featherfx.lab.vane.hooked import CycleTest, TearTest, cycle, tear
from featherfx.lab.vane.mesoscale import (
    AnglesTest,
    BandTest,
    angle_slopes,
    run_bands,
    run_size_effect,
    shear_bands,
)
from featherfx.lab.vane.traction import LockingTest, Traction, run_locking, run_traction


class _NewFile(click.Path):
    """A file that a command writes, and that is not there yet."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if Path(value).exists():
            self.fail(f"{value} exists already. Choose another name", param, ctx)
        return super().convert(value, param, ctx)


_FILE = _NewFile(path_type=Path, dir_okay=False)
_PRESETS = presets_option(click.Command("")).params[0]


def _feather(test: FeatherTest, preset_folders: tuple[Path, ...]) -> Iterator[Any]:
    if (test.shake_amplitude is None) != (test.shake_frequency is None):
        raise click.UsageError("--shake-amplitude and --shake-frequency belong together")
    if test.shake_amplitude is not None and test.pull is not None:
        raise click.UsageError("--pull and --shake-amplitude exclude each other")
    yield run_feather(test, preset_folders)


def _modes(
    test: ModesTest, kind: str | None, air: bool, preset_folders: tuple[Path, ...]
) -> Iterator[Any]:
    rod = test.rod.length is not None and test.rod.ei is not None
    if kind is None and not rod:
        raise click.UsageError("Give --length and --ei of a rod, or --kind of a feather")
    if kind is None and air:
        raise click.UsageError("--air belongs to --kind: a rod has no vane that carries air")
    if kind is not None and (test.rod.length, test.rod.ei) != (None, None):
        raise click.UsageError("--kind has its own --length and --ei. Leave them out")
    if kind is None:
        found = find_rod_modes(test)
    else:
        found = find_feather_modes(kind, test.count, air, preset_folders)
    yield {"frequencies_hz": found.frequencies, "decrements": found.decrements}


def _ribbon(test: HangTest) -> Iterator[Any]:
    ribbon = replace(test.ribbon, finite_width=not test.sadowsky)
    hung = hang(ribbon, test.clamp, planar=test.planar)
    rest, size = hung.rest, ribbon.nodes
    times, tips = blown(test, hung)
    moved = {"times": times, "tips": tips} if test.seconds else {}
    yield {
        "tip": rest.curve.points[-1],
        "points": rest.curve.points,
        "curvature": rest.unknowns[:size],
        "ruling": rest.unknowns[size:],
        "out_of_plane": hung.out_of_plane,
        "energy": rest.energy,
        "stability": rest.stability,
        "iterations": rest.iterations,
        "residual": rest.residual,
        "seconds": hung.seconds,
    } | moved


def _full_feather(test: FullPull) -> Iterator[Any]:
    found = pull_feather(test)
    yield {each.name: getattr(found, each.name) for each in fields(found) if each.name != "rest"}


def _unit_cell(
    test: CellTest, save: Path | None, preset_folders: tuple[Path, ...]
) -> Iterator[Any]:
    kind = feather_kind(test.preset, preset_folders)
    cell = test.cell(kind)
    found = cell_moduli(cell)
    if save is not None:
        save.parent.mkdir(parents=True, exist_ok=True)
        write_text(save, vane_text(vane_of(cell, kind.vane_material), test.preset))
    keys = ("along", "across", "shear", "bending_along", "bending_across", "poisson")
    own = {"crossings": 2 * cell.crossings - 1, "barbule_spacing": cell.height}
    yield {key: getattr(found, key) for key in keys} | own


def _precondition(test: PreconditionTest) -> Iterator[Any]:
    found = vars(precondition(test))
    yield {name: found[name] for name in found if name != "displacements"}


def _mesoscale(test: BandTest, size_effect: bool) -> Iterator[Any]:
    if size_effect:
        yield run_size_effect(fraction=test.bands.bands().barb_fraction)
    else:
        yield run_bands(test)


def _calibrate(
    test: CalibrateTest, file: Path, save: Path | None, name: str | None, law: str | None
) -> Iterator[Any]:
    if law is not None:
        if save is not None or name is not None:
            raise click.UsageError("--save and --name do not go with --law")
        yield fit_tissue(law, *read_tissue(file), str(file))
        return
    if (save is None) != (name is None):
        raise click.UsageError("--save and --name belong together")
    if save is not None and name is not None:
        check_name(save, name)
    curves = read_curves(file)
    found = calibrate(curves, test.elements, str(file))
    yield found
    if save is not None and name is not None:
        thickness = sum(curve.sample.thickness for curve in curves) / len(curves)
        yield save_preset(save, name, found, thickness)


def _angles(test: AnglesTest) -> Iterator[Any]:
    bands = test.bands.bands()
    slopes = angle_slopes(bands, test.angle)
    found = shear_bands(bands, slopes.fitted.moduli, test.aspect)
    yield {**slopes.as_json(), "shear_bands": found}


_FEATHER_IN_AIR = (
    click.Option(["--kind"], help="Feather preset, instead of a rod."),
    click.Option(["--air"], is_flag=True, help="In still air that the feather carries along."),
)
_SAVE_CELL = click.Option(
    ["--save"],
    type=_FILE,
    metavar="FILE",
    help="A material preset with these moduli; what the cell does not tell is the preset's.",
)
_SIZE_EFFECT = click.Option(
    ["--size-effect"], is_flag=True, help="Press along the barbs instead, for four widths."
)
_CALIBRATION = (
    click.Argument(["file"], type=readable_path()),
    click.Option(
        ["--save"],
        type=click.Path(path_type=Path, file_okay=False),
        metavar="FOLDER",
        help="Save as a material preset in this folder of presets.",
    ),
    click.Option(["--name"], help="Of the preset."),
    click.Option(
        ["--law"],
        type=click.Choice(list(LAWS)),
        help="Fit a law of soft tissue to columns strain, stress and strain_across instead.",
    ),
)

EXPERIMENTS = {
    "rod": Experiment(
        BendTest,
        lambda test: [bend(test.rod, test.tip_force)],
        "--length 1 --ei 1 --tip-force 0,0,-2",
        "--length 78.54 --ei 833333 --rest-curvature 0.01 --tip-force 0,0,300 --json",
    ),
    "modes": Experiment(
        ModesTest,
        _modes,
        "--length 1 --ei 1 --line-mass 1 --count 4",
        "--kind swan_primary --air --json",
        more=(*_FEATHER_IN_AIR, _PRESETS),
    ),
    "air": Experiment(
        StreamTest,
        lambda test, preset_folders: [measure_stream(test, preset_folders)],
        "--kind swan_primary --angles 5,10,30,60,90 --speed 10",
        more=(_PRESETS,),
    ),
    "fall": Experiment(
        FallTest,
        lambda test, preset_folders: [measure_fall(test, preset_folders)],
        "--kind down --json",
        more=(_PRESETS,),
    ),
    "release": Experiment(
        ReleaseTest,
        lambda test: [release(test)],
        "--length 1 --ei 1 --line-weight 1 --duration 4 --tolerance 1e-5",
    ),
    "feather": Experiment(
        FeatherTest,
        _feather,
        "--preset swan_primary --shake-amplitude 0.05 --shake-frequency 3",
        "--preset tail_feather --pull 0,0,0.05 --duration 1 --json",
        more=(_PRESETS,),
    ),
    "strip": Experiment(
        StripTest,
        lambda test: [run_strip(test)],
        "--scene iso --dt 0.0125",
        "--scene feather --dt 0.01 --kinematics barb-curvature --json",
    ),
    "plate": Experiment(
        PlateTest,
        lambda test: [run_plate(test)],
        "--along 1e-4 --across 1e-4 --twist 3.5e-5 --coupling 3e-5 --width 0.1",
        "--along 1e-4 --across 2e-5 --twist 3e-5 --angle 60 --json",
    ),
    "contact": Experiment(
        ContactTest,
        lambda test: [run_contact(test)],
        "--case plates --quality final",
        "--case stack --n 8 --at-rest --json",
        "--case slide --steps 64",
    ),
    "ribbon": Experiment(
        HangTest,
        _ribbon,
        "--length 0.5 --width 0.01 --rigidity 2e-4 --density 0.1 --rest-curvature 60",
        "--length 0.2 --width 0.01 --rigidity 2e-4 --density 0.1 --sadowsky --json",
    ),
    "fullfeather": Experiment(
        FullPull,
        _full_feather,
        "--scene side",
        "--scene tip --material isotropic --distance 0.2 --json",
    ),
    "unitcell": Experiment(
        CellTest,
        _unit_cell,
        "--preset swan_primary",
        "--preset swan_primary --angle 40 --diameter 12e-6 --hooks 4 --json",
        "--preset swan_primary --diameter 13e-6 --save my_vane.toml",
        more=(_SAVE_CELL, _PRESETS),
    ),
    "network": Experiment(
        NetworkTest,
        lambda test: [network_moduli(test.plan.layout(periodic=True))],
        "--lattice triangular --dilution 0.8 --bend 1e-4",
        "--lattice mikado --fibres 2000 --seed 1 --json",
    ),
    "precondition": Experiment(
        PreconditionTest,
        _precondition,
        "--size 48 --method pcg --preconditioner P_J",
        "--lattice mikado --method minres --preconditioner P_Db --tolerance 1e-3 --json",
    ),
    "traction": Experiment(
        Traction,
        lambda test: [run_traction(test)],
        "--angle 45 --width 0.013 --height 0.018",
        "--angle 30 --width 0.013 --height 0.018 --model inextensible --json",
    ),
    "locking": Experiment(
        LockingTest, lambda test: [run_locking(test.ratio, test.elements)], "--ratio 1e4 --json"
    ),
    "mesoscale": Experiment(
        BandTest,
        _mesoscale,
        "--barb-fraction 0.14",
        "--angle 45 --strain 0.1 --json",
        "--size-effect",
        more=(_SIZE_EFFECT,),
    ),
    "tear": Experiment(
        TearTest,
        lambda test: [tear(test)],
        "--direction across",
        "--direction tilted --rows 41 --json",
    ),
    "cycle": Experiment(
        CycleTest, lambda test: [cycle(test)], "--direction across --strains 0.1,0.2,0.3 --json"
    ),
    "rupture": Experiment(
        RuptureTest,
        lambda test: [run_rupture(test)],
        "--elements 1 --sigma 1.5708 --mu 1.5708",
        "--elements 9 --sigma 0.5236 --weak 2 --json",
    ),
    "calibrate": Experiment(
        CalibrateTest,
        _calibrate,
        "tests.csv --json",
        "tests.csv --save mine --name my_vane",
        "skin.csv --law sacks",
        more=_CALIBRATION,
    ),
    "angles": Experiment(AnglesTest, _angles, "--json"),
}
COMMANDS: dict[str, click.Command] = {
    **{name: command_from(name, each) for name, each in EXPERIMENTS.items()},
    "report": report,
}
