"""Other simulators on the falling strip of lab/strip.py, beside ours, in one run.

Sheets of the falling strip (lab/strip.py) in other programs: MuJoCo and Newton.

MuJoCo (Todorov et al. 2012): a flex of triangles with the shell elasticity of its own, without
contact and damping, by its `discrete` integrator.

Newton: cloth of triangles whose diagonals alternate, without contact and damping. In a cylinder of
curvature k along the strip only edges across it fold, by k a, a the length of a cell; its bending
stiffness D per width then follows from the energies of a fold of angle t:

    VBD (Chen et al. 2024)        1/2 K l t^2               K = D / a
    Style3D (Bergou et al. 2006)  1/2 K 3 l^2 t^2 / A       K = D / 3,    A = a l, both triangles

l: length of the fold. VBD's membrane is stable Neo-Hookean with a ratio of areas as its second
invariant: no Poisson effect where both its moduli are E h / 2.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
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
from featherfx.lab.strip import (
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

FALL_END = 0.2  # s
NEWTON_ITERATIONS, STYLE3D_LINEAR = 10, 30
# Style3D hardly moves at the strip's own stretch stiffness, and errs least at this share of it
STYLE3D_STRETCH = 1e-3
_OLDEST_MUJOCO, _OLDEST_NEWTON = (4, 0), (1, 8)
_COLUMNS = 12
_ALONG, _ACROSS = STRIP_LENGTH / CELLS, STRIP_WIDTH / _COLUMNS
_BENDING = STIFF * STRIP_THICKNESS**2 / 12.0  # N m
_APART = 0.1  # m, between sheets of a wing
_MODEL = """
<mujoco>
  <option timestep="{step}" gravity="{gravity}" integrator="discrete">
    <flag contact="disable"/>
  </option>
  <worldbody>{sheets}</worldbody>
</mujoco>
"""
_SHEET = """
    <flexcomp name="strip_{number}" type="grid" dim="2" count="{rows} {columns} 1"
        spacing="{along} {across} 1" mass="{mass}" radius="{radius}" pos="{middle} {side} 0">
      <elasticity young="{young}" poisson="0" thickness="{thickness}" damping="0"
          elastic2d="both"/>
      <contact contype="0" conaffinity="0" selfcollide="none"/>
      <pin gridrange="0 0 1 {last}"/>
      <edge equality="false"/>
    </flexcomp>"""


@dataclass(frozen=True)
class PeerRun:
    """tips: (S, T, 3) m at the output times up to FALL_END, of S sheets that are clamped at their
    own origins. cpu_seconds: of stepping. steps: count."""

    tips: Array
    cpu_seconds: float
    steps: int


def peer_version(name: str) -> str:
    """Version of an installed peer."""
    from importlib.metadata import version

    return version(name)


def mujoco_sheets(step: float, sheets: int) -> PeerRun:
    """Sheets by MuJoCo with steps of the given length (s), until FALL_END."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(_mujoco_model(step, sheets))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ends = _ends(data.flexvert_xpos, sheets)

    def points(steps: int) -> Array:
        for _ in range(steps):
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_flex(model, data)
        return np.array(data.flexvert_xpos[ends])

    return _timed(points, step, sheets)


def newton_vbd(step: float, sheets: int) -> PeerRun:
    """Sheets as cloth by Newton's VBD on the processor, until FALL_END."""
    from newton.solvers import SolverVBD

    def add(builder: Any, sheet: dict[str, Any]) -> None:
        stretch = 0.5 * STIFF
        builder.add_cloth_mesh(
            scale=1.0,
            tri_ke=stretch,
            tri_ka=stretch,
            tri_kd=0.0,
            edge_ke=_BENDING / _ALONG,
            edge_kd=0.0,
            **sheet,
        )

    def solver(model: Any) -> Any:
        return SolverVBD(
            model=model, iterations=NEWTON_ITERATIONS, particle_enable_self_contact=False
        )

    return _newton_sheets(step, sheets, add, solver, lambda b: b.color(include_bending=True))


def newton_style3d(step: float, sheets: int) -> PeerRun:
    """Sheets as cloth by Newton's Style3D on the processor, until FALL_END."""
    import warp
    from newton.solvers import SolverStyle3D, style3d

    def add(builder: Any, sheet: dict[str, Any]) -> None:
        stretch, fold = STYLE3D_STRETCH * STIFF, _BENDING / 3.0
        style3d.add_cloth_mesh(
            builder,
            tri_aniso_ke=warp.vec3(stretch, stretch, 0.5 * stretch),
            edge_aniso_ke=warp.vec3(fold, fold, fold),
            **sheet,
        )

    def solver(model: Any) -> Any:
        made = SolverStyle3D(
            model=model,
            config=SolverStyle3D.Config(
                iterations=NEWTON_ITERATIONS, linear_iterations=STYLE3D_LINEAR
            ),
        )
        made.collision = None
        return made

    return _newton_sheets(step, sheets, add, solver, None, SolverStyle3D.register_custom_attributes)


def _newton_sheets(
    step: float,
    sheets: int,
    add: Callable[[Any, dict[str, Any]], None],
    solver: Callable[[Any], Any],
    finish: Callable[[Any], Any] | None,
    start: Callable[[Any], Any] | None = None,
) -> PeerRun:
    import newton
    import warp

    warp.config.quiet = True
    with warp.ScopedDevice("cpu"):
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=GRAVITY_ALONG_Z)
        if start is not None:
            start(builder)
        for number in range(sheets):
            first = builder.particle_count
            add(builder, _newton_sheet(number * _APART))
            active = int(newton.ParticleFlags.ACTIVE)
            for each in range(first, builder.particle_count):
                if builder.particle_q[each][0] < 1.5 * _ALONG:
                    builder.particle_mass[each] = 0.0
                    builder.particle_flags[each] = int(builder.particle_flags[each]) & ~active
        if finish is not None:
            finish(builder)
        model = builder.finalize()
        made, control = solver(model), model.control()
        state, other = model.state(), model.state()
        ends = _ends(state.particle_q.numpy(), sheets)
        made.step(state, other, control, None, step)  # compiles before anything is timed
        made, state, other = solver(model), model.state(), model.state()

        def points(steps: int) -> Array:
            nonlocal state, other
            for _ in range(steps):
                state.clear_forces()
                made.step(state, other, control, None, step)
                state, other = other, state
            return state.particle_q.numpy()[ends].astype(float)

        return _timed(points, step, sheets)


def _newton_sheet(side: float) -> dict[str, Any]:
    """Mesh of a sheet whose middle line starts at (0, side, 0)."""
    import warp

    rows, columns = CELLS + 1, _COLUMNS + 1
    vertices = [
        warp.vec3(i * _ALONG, (j - 0.5 * _COLUMNS) * _ACROSS, 0.0)
        for j in range(columns)
        for i in range(rows)
    ]
    triangles: list[int] = []
    for j in range(_COLUMNS):
        for i in range(CELLS):
            a, b = j * rows + i, j * rows + i + 1
            c, d = b + rows, a + rows
            triangles += [a, b, d, b, c, d] if (i + j) % 2 else [a, b, c, a, c, d]
    return {
        "pos": warp.vec3(0.0, side, 0.0),
        "rot": warp.quat_identity(),
        "vel": warp.vec3(0.0, 0.0, 0.0),
        "vertices": vertices,
        "indices": triangles,
        "density": STRIP_DENSITY,
        "particle_radius": 0.5 * STRIP_THICKNESS,
    }


def _ends(points: Array, sheets: int) -> Sequence[int]:
    """Indices of the points in the middle of the free ends."""
    wanted = [(STRIP_LENGTH, number * _APART, 0.0) for number in range(sheets)]
    return [int(np.linalg.norm(points - each, axis=1).argmin()) for each in wanted]


def _timed(points: Callable[[int], Array], step: float, sheets: int) -> PeerRun:
    """Step to each output time. points: advances by a number of steps, (S, 3) m of the ends."""
    sides = np.arange(sheets)[:, None] * [0.0, _APART, 0.0]
    tips, seconds, done = [], 0.0, 0
    for output in (each for each in OUTPUT_TIMES if each <= FALL_END):
        steps = round(output / step) - done
        begin = time.process_time()
        ends = points(steps)
        seconds += time.process_time() - begin
        done += steps
        tips.append(ends - sides)
    return PeerRun(np.stack(tips, axis=1), seconds, done)


def _mujoco_model(step: float, sheets: int) -> str:
    made = [
        _SHEET.format(
            number=number,
            rows=CELLS + 1,
            columns=_COLUMNS + 1,
            last=_COLUMNS,
            along=_ALONG,
            across=_ACROSS,
            mass=STRIP_DENSITY * STRIP_LENGTH * STRIP_WIDTH,
            radius=0.5 * STRIP_THICKNESS,
            middle=0.5 * STRIP_LENGTH,
            side=number * _APART,
            young=STIFF / STRIP_THICKNESS,
            thickness=STRIP_THICKNESS,
        )
        for number in range(sheets)
    ]
    gravity = " ".join(f"{each:g}" for each in GRAVITY_ALONG_Z)
    return _MODEL.format(step=step, gravity=gravity, sheets="".join(made))


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
    for name, oldest in (("mujoco", _OLDEST_MUJOCO), ("newton", _OLDEST_NEWTON)):
        wanted = f"needs {name} {oldest[0]}.{oldest[1]} or later: pip install 'featherfx[peers]'"
        if importlib.util.find_spec(name) is None:
            raise InputError(Problem("bench", "peers", wanted))
        found = peer_version(name)
        if tuple(int(each) for each in found.split(".")[:2]) < oldest:
            raise InputError(Problem("bench", "peers", f"{wanted}, found {found}"))
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
