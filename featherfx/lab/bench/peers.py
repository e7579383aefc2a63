"""Other simulators on the falling strip of lab/feathers/strip.py, beside ours, in one run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array
from featherfx.lab.bench.peer_programs import (
    FALL_END,
    NEWTON_ITERATIONS,
    STYLE3D_LINEAR,
    STYLE3D_STRETCH,
    PeerRun,
    mujoco_sheets,
    newton_style3d,
    newton_vbd,
    peer_version,
    require_peers,
)
from featherfx.lab.bench.report import (
    ResultTable,
    Row,
    as_csv,
    as_markdown,
    can_plot,
    facts_of,
    machine,
    work_precision_plot,
)
from featherfx.lab.feathers.strip import StripTest, run_strip

WING_SHEETS = 20
COST, ERROR = "CPU s a simulated second", "error"
_INTRODUCTION = """\
This page is what `featherfx bench --peers -o DIR` writes; no number on it is typed in. All programs
simulate the strip of `featherfx lab strip` on one thread; times are processor times of stepping.
Compare ratios, not seconds, between machines.
"""


@dataclass(frozen=True)
class PeerRates:
    """Amount to measure, 1/s: steps a second of our isotropic strip, of MuJoCo's, of Newton's, and
    of our feather strip."""

    rates: tuple[int, ...]
    mujoco: tuple[int, ...]
    newton: tuple[int, ...]
    feather: tuple[int, ...]


FULL_RATES = PeerRates(
    (40, 60, 80, 100, 160, 320), (240, 500, 1000, 2000, 4000), (240, 500, 1000), (60, 120, 240)
)
QUICK_RATES = PeerRates((40, 80, 100), (240, 1000), (240,), (60, 240))
_WING_RATES = PeerRates((40, 100), (240, 2000), (240, 500), ())
# columns do not matter where there is no Poisson effect; four times the cells along the strip
_ISO_REFERENCE = StripTest("iso", 1.0 / 2560.0, columns=1, refinement=4, newton=1e-7)
_FEATHER_REFERENCE = StripTest(
    "feather", 1.0 / 960.0, "barb-curvature", coefficients=3, newton=1e-7
)


def our_sheets(step: float, sheets: int) -> PeerRun:
    """Isotropic strips by our nodal kinematics, each by itself."""
    runs = [run_strip(StripTest("iso", step), FALL_END) for _ in range(sheets)]
    return PeerRun(
        np.stack([each.tip for each in runs]), sum(each.cpu_seconds for each in runs), runs[0].steps
    )


def peer_tables(extent: PeerRates) -> Iterator[ResultTable]:
    """All tables. Raises InputError at once where a peer is missing."""
    require_peers()
    reference = run_strip(_ISO_REFERENCE, FALL_END).tip
    fine = _ISO_REFERENCE
    note = (
        "The isotropic strip of 100 x 12 cells, 0.2 s from its release. Error: distance in m of"
        " the middle of its end from the reference, the larger of those at 0.1 and 0.2 s."
        f" Reference: featherfx with {fine.refinement} times the cells along the strip and"
        f" {round(1.0 / fine.dt)} steps a second; a chain of rigid links agrees with it (see the"
        " page of the lab). MuJoCo: flex with elastic2d = both, integrator discrete, at most 100"
        " iterations of its solver, as by default."
        f" Newton: cloth with {NEWTON_ITERATIONS} iterations a step; for Style3D each of"
        f" {STYLE3D_LINEAR} linear ones, and {STYLE3D_STRETCH:g} of the strip's stiffness in its"
        " plane, where it errs least."
    )
    rows = iso_rows(extent, 1, reference)
    yield ResultTable("peers_iso", "Isotropic strip", note, rows)
    note = (
        f"{WING_SHEETS} such strips in one scene. Error: that of the worst strip. Where MuJoCo's"
        " solve runs out of iterations, MUJOCO_LOG.TXT in the current folder says so."
    )
    rows = iso_rows(_WING_RATES, WING_SHEETS, reference)
    yield ResultTable("peers_wing", f"A wing of {WING_SHEETS} strips", note, rows)
    yield feather_table(extent)


def iso_rows(extent: PeerRates, sheets: int, reference: Array) -> list[Row]:
    """Error against processor time of all programs on isotropic strips."""
    newton = f"Newton {peer_version('newton')}"
    programs: tuple[tuple[str, Callable[[float, int], PeerRun], tuple[int, ...]], ...] = (
        ("featherfx, nodal", our_sheets, extent.rates),
        (f"MuJoCo {peer_version('mujoco')}", mujoco_sheets, extent.mujoco),
        (f"{newton}, VBD", newton_vbd, extent.newton),
        (f"{newton}, Style3D", newton_style3d, extent.newton),
    )
    return [
        _row(name, rate, run(1.0 / rate, sheets), reference)
        for name, run, rates in programs
        for rate in rates
    ]


def feather_table(extent: PeerRates) -> ResultTable:
    """Cost, error and barb strain of our feather strip in both kinematics."""
    reference = run_strip(_FEATHER_REFERENCE, FALL_END).tip
    start = StripTest("feather", 1.0)
    methods = {
        "barb-curvature, 1 coefficient": replace(
            start, kinematics="barb-curvature", coefficients=1
        ),
        "barb-curvature, 2 coefficients": replace(start, kinematics="barb-curvature"),
        "nodal, stiff barbs": start,
        "nodal, inextensible barbs": replace(start, stretch="inextensible"),
    }
    rows: list[Row] = []
    for name, test in methods.items():
        for rate in extent.feather:
            run = run_strip(replace(test, dt=1.0 / rate), FALL_END)
            done = PeerRun(run.tip[None], run.cpu_seconds, run.steps)
            rows.append({**_row(name, rate, done, reference), "barb strain": run.strain_max})
    fine = _FEATHER_REFERENCE
    note = (
        "The strip with barbs and a rachis, measured as above. Reference: barb-curvature with"
        f" {fine.coefficients} coefficients and {round(1.0 / fine.dt)} steps a second. Barb"
        " strain: largest relative change of a barb segment's length after any step."
    )
    return ResultTable("peers_feather", "Feather strip", note, rows)


def _row(name: str, rate: int, run: PeerRun, reference: Array) -> Row:
    return {
        "program": name,
        "steps a second": rate,
        "steps": run.steps,
        ERROR: float(np.linalg.norm(np.subtract(run.tips, reference), axis=-1).max()),
        COST: run.cpu_seconds / FALL_END,
    }


def peer_page(tables: list[ResultTable], program: str) -> str:
    """The run as Markdown; program: version of featherfx."""
    date, facts = facts_of(machine(program))
    head = f"Measured on {date}. Machine and versions: {facts}.\n"
    parts = [f"# Beside other simulators\n\n{_INTRODUCTION}", head]
    for table in tables:
        parts.append(as_markdown(table))
        if can_plot():
            parts.append(f"![Error against processor time]({table.name}.png)\n")
    return "\n".join(parts)


def peer_files(tables: list[ResultTable], program: str) -> dict[str, bytes]:
    """Page, CSV files and, where matplotlib is installed, plots of error against time."""
    files = {"peers.md": peer_page(tables, program).encode()}
    for table in tables:
        files[f"{table.name}.csv"] = as_csv(table).encode()
        if can_plot():
            picture = work_precision_plot(table.rows, "program", COST, ERROR)
            files[f"{table.name}.png"] = picture
    return files
