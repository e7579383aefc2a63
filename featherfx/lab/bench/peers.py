"""Other simulators on the falling strip of lab/feathers/strip.py, beside ours, in one run.

MuJoCo (Todorov et al. 2012) simulates the isotropic strip as a flex of triangles with the shell
elasticity of its own, without contact and damping, by its `discrete` integrator.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem
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
from featherfx.lab.feathers.strip import (
    CELLS,
    GRAVITY_ALONG_Z,
    OUTPUT_TIMES,
    STIFF,
    STRIP_DENSITY,
    STRIP_LENGTH,
    STRIP_THICKNESS,
    STRIP_WIDTH,
    StripTest,
    run_strip,
)

_COLUMNS = 12
_END = 0.2
_OLDEST = 4
COST, ERROR = "CPU s a simulated second", "error"
_INTRODUCTION = """\
This page is what `featherfx bench --peers -o DIR` writes; no number on it is typed in. All programs
simulate the strip of `featherfx lab strip` on one thread; times are processor times of stepping.
Compare ratios, not seconds, between machines.
"""
_MODEL = """
<mujoco>
  <option timestep="{step}" gravity="{gravity}" integrator="discrete">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <flexcomp name="strip" type="grid" dim="2" count="{rows} {columns} 1"
        spacing="{along} {across} 1" mass="{mass}" radius="{radius}" pos="{middle} 0 0">
      <elasticity young="{young}" poisson="0" thickness="{thickness}" damping="0"
          elastic2d="both"/>
      <contact contype="0" conaffinity="0" selfcollide="none"/>
      <pin gridrange="0 0 1 {last}"/>
      <edge equality="false"/>
    </flexcomp>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class PeerRates:
    """Amount to measure. rates: 1/s, steps a second of our iso strip; peer_rates: of MuJoCo's;
    feather_rates: of our feather strip."""

    rates: tuple[int, ...]
    peer_rates: tuple[int, ...]
    feather_rates: tuple[int, ...]


FULL_RATES = PeerRates((40, 60, 80, 100, 160, 320), (240, 500, 1000, 2000, 4000), (60, 120, 240))
QUICK_RATES = PeerRates((40, 80, 100), (240, 1000), (60, 240))
# columns do not matter where there is no Poisson effect; four times the cells along the strip
_ISO_REFERENCE = StripTest("iso", 1.0 / 2560.0, columns=1, refinement=4, newton=1e-7)
_FEATHER_REFERENCE = StripTest(
    "feather", 1.0 / 960.0, "barb-curvature", coefficients=3, newton=1e-7
)


@dataclass(frozen=True)
class PeerRun:
    """tip: (T, 3) m at the output times up to _END. cpu_seconds: of stepping. steps: count."""

    tip: Array
    cpu_seconds: float
    steps: int


def mujoco_or_error() -> Any:
    """The module mujoco. Raises InputError where it is not installed or too old."""
    wanted = f"needs MuJoCo {_OLDEST} or later: pip install 'featherfx[peers]'"
    if importlib.util.find_spec("mujoco") is None:
        raise InputError(Problem("bench", "peers", wanted))
    import mujoco

    if int(mujoco.__version__.split(".")[0]) < _OLDEST:
        raise InputError(Problem("bench", "peers", f"{wanted}, found {mujoco.__version__}"))
    return mujoco


def mujoco_iso(step: float) -> PeerRun:
    """The isotropic strip by MuJoCo with steps of the given length (s), until _END."""
    mujoco = mujoco_or_error()
    model = mujoco.MjModel.from_xml_string(_mujoco_model(step))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    end = np.linalg.norm(data.flexvert_xpos - [STRIP_LENGTH, 0.0, 0.0], axis=1).argmin()
    tips, seconds, steps = [], 0.0, 0
    for output in (each for each in OUTPUT_TIMES if each <= _END):
        begin = time.process_time()
        while data.time < output - 0.5 * step:
            mujoco.mj_step(model, data)
            steps += 1
        seconds += time.process_time() - begin
        mujoco.mj_forward(model, data)
        tips.append(data.flexvert_xpos[end].copy())
    return PeerRun(np.array(tips), seconds, steps)


def _mujoco_model(step: float) -> str:
    return _MODEL.format(
        step=step,
        gravity=" ".join(f"{each:g}" for each in GRAVITY_ALONG_Z),
        rows=CELLS + 1,
        columns=_COLUMNS + 1,
        last=_COLUMNS,
        along=STRIP_LENGTH / CELLS,
        across=STRIP_WIDTH / _COLUMNS,
        mass=STRIP_DENSITY * STRIP_LENGTH * STRIP_WIDTH,
        radius=0.5 * STRIP_THICKNESS,
        middle=0.5 * STRIP_LENGTH,
        young=STIFF / STRIP_THICKNESS,
        thickness=STRIP_THICKNESS,
    )


def our_iso(step: float) -> PeerRun:
    """The isotropic strip by our nodal kinematics."""
    run = run_strip(StripTest("iso", step), _END)
    return PeerRun(run.tip, run.cpu_seconds, run.steps)


def peer_tables(extent: PeerRates) -> Iterator[ResultTable]:
    """Both tables. Raises InputError at once where a peer is missing."""
    mujoco_or_error()
    yield iso_table(extent)
    yield feather_table(extent)


def iso_table(extent: PeerRates) -> ResultTable:
    """Error against processor time of all programs on the isotropic strip."""
    version = mujoco_or_error().__version__
    reference = run_strip(_ISO_REFERENCE, _END).tip
    programs: tuple[tuple[str, Callable[[float], PeerRun], tuple[int, ...]], ...] = (
        ("featherfx, nodal", our_iso, extent.rates),
        (f"MuJoCo {version}", mujoco_iso, extent.peer_rates),
    )
    rows: list[Row] = []
    for name, run, rates in programs:
        for rate in rates:
            done = run(1.0 / rate)
            rows.append(_row(name, rate, done, reference))
    fine = _ISO_REFERENCE
    note = (
        "The isotropic strip of 100 x 12 cells, 0.2 s from its release. Error: distance in m of"
        " the middle of its end from the reference, the larger of those at 0.1 and 0.2 s."
        f" Reference: featherfx with {fine.refinement} times the cells along the strip and"
        f" {round(1.0 / fine.dt)} steps a second; a chain of rigid links agrees with it (see the"
        " page of the lab). MuJoCo: flex with elastic2d = both, integrator discrete."
    )
    return ResultTable("peers_iso", "Isotropic strip", note, rows)


def feather_table(extent: PeerRates) -> ResultTable:
    """Cost, error and barb strain of our feather strip in both kinematics."""
    reference = run_strip(_FEATHER_REFERENCE, _END).tip
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
        for rate in extent.feather_rates:
            run = run_strip(replace(test, dt=1.0 / rate), _END)
            done = PeerRun(run.tip, run.cpu_seconds, run.steps)
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
        ERROR: float(np.linalg.norm(np.subtract(run.tip, reference), axis=1).max()),
        COST: run.cpu_seconds / _END,
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
