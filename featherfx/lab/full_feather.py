"""A whole feather held at its base and pulled in the plane of its vane, with three materials.

Scenarios of Jouve 2024, figures 6.5 (the rachis' tip is pulled) and 6.9 (the edge of the vane is
pulled), parameters of table 6.1: a flat feather of 0.2 m. The rest lies in the xy plane, rachis
along +x, leading vane towards +y; the pull is along -y, quasi-static, in equal parts. A feather
that is exactly flat never wrinkles, so small random forces along z (1e-4 N, fixed seed) push its
nodes off the plane during the pull; they are taken away before the last rest, and what did not
buckle falls back.

The table does not tell the rachis's width: here 4 mm at the base, 1 mm at the tip. The height is
five times the width, so that at the base the bending stiffness within the plane is that of the
table's rectangular band of 12 mm: an ellipse of height h bends as a band of 3 pi / 16 h.

The three materials differ in the vane only:
    barbs       moduli of the swan vane; barb-curvature kinematics, barbs exactly inextensible
    cloth       a measured T-shirt fabric, 2.1 times stiffer along than across, nodal kinematics
    isotropic   Young's modulus of the swan vane across its barbs, no Poisson effect, nodal
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from scipy.interpolate import CubicSpline

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import arc_lengths
from featherfx.errors import require
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind, VaneShape
from featherfx.lab.declare import Range, out_of_range, value
from featherfx.lab.feather import barb_strain, feather_kind
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver, nodal_rest_state
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, no_loads
from featherfx.solver.solver import Settings, Solver, raise_if_failed
from featherfx.solver.state import rest_state

Scene = Literal["tip", "side"]
Material = Literal["barbs", "cloth", "isotropic"]

VANE_MATERIALS: tuple[Material, ...] = get_args(Material)
# table 6.1, SI units
FEATHER_LENGTH = 0.2
_RACHIS = RachisMaterial(
    youngs_modulus=34e6,
    shear_modulus=34e6 / 2.98,
    cortex_fraction=1.0,
    flattening=5.0,
    cortex_density=700.0,
)
_WIDTH_BASE, _WIDTH_TIP = 4e-3, 1e-3
SWAN = VaneMaterial(
    modulus_along_barbs=3.6e8,
    modulus_across_barbs=4.8e4,
    shear_modulus=2.78e4,
    thickness=1.2e-4,
    surface_density=2.6e-2,
    barb_bending_normal=2.5e-4,
    barb_bending_in_plane=8.5e-5,
    bending_across=1e-7,
)
# isotropic without Poisson effect: the shear modulus is half of Young's; its hinges take the
# bending of the vane, and nothing bends within its plane that is not stretched or sheared
_ISOTROPIC = replace(
    SWAN,
    modulus_along_barbs=4.8e4,
    shear_modulus=2.4e4,
    barb_bending_normal=5e-3,
    bending_across=2.5e-8,
    barb_bending_in_plane=1e-12,
)
# "gray-interlock" of Wang, Ramamoorthi and O'Brien 2011, as ARCSim's file of that name has it:
# stretching at zero strain, halves of N/m, and bending in N m along two directions. Its shear entry
# is in a measure of its own; half of the modulus across instead, as if it had no Poisson effect
_WEFT, _WARP, _WEFT_BENDING, _WARP_BENDING = 16.593832, 34.477123, 23.191698e-6, 14.267624e-6
_CLOTH = replace(
    _ISOTROPIC,
    modulus_along_barbs=2.0 * _WARP / SWAN.thickness,
    modulus_across_barbs=2.0 * _WEFT / SWAN.thickness,
    shear_modulus=_WEFT / SWAN.thickness,
    barb_bending_normal=_WEFT_BENDING,
    bending_across=_WARP_BENDING,
)
# of the penalty on lost area, equation 6.6
_KAPPA = 5.04e7
_VANES = {"barbs": SWAN, "cloth": _CLOTH, "isotropic": _ISOTROPIC}

# N, root mean square of the forces that push the nodes off their plane
_IMPERFECTION, _SEED = 1e-4, 1
# halvings of a part of the pull for which no rest is found
_HALVINGS = 4
_GRIP_STIFFNESS = 1e3
# where the vane's edge is pulled, as a share of the rows
_SIDE_ROW = 0.7
_SETTLED = 1e-7
# a wrinkled edge has at least so many waves, and at least this amplitude (m)
_WAVES, MIN_WRINKLE = 3.0, 2.5e-4 * FEATHER_LENGTH
_PADDING = 8


@dataclass(frozen=True)
class FullPull:
    """Pull a flat feather of 0.2 m, held at its base, along the plane of its vane.

    Keys: rachis_deflection (over the length), barb_strain, force, wavelength (null: no wrinkles)
    and amplitude of the wrinkles along the edges, iterations, seconds, points.
    """

    scene: Scene = value("Pull the rachis' tip, or the edge of the trailing vane.")
    distance: float = value(
        "Share of the length.", 0.1, Range(0.0, 0.6, above=True, unit="of the feather's length")
    )
    parts: int = value("Equal steps of the pull.", 10, Range(1, 200))
    rows: int = value("Rachis rows.", 41, Range(9, 200))
    columns: int = value("Barb columns a side.", 8, Range(2, 50))
    material: Material = value("Of the vane.", "barbs")
    nodal: bool = value("Barbs in the nodal kinematics, as a check.", False)
    guard: bool = value("With the penalty on lost area of table 6.1.", False)

    def __post_init__(self) -> None:
        require(*out_of_range(self, "pull"))


@dataclass(frozen=True)
class PulledFeather:
    """Outcome of a pull.

    rachis_deflection: distance that the rachis tip moved, over the length. barb_strain: largest
    relative change of a barb segment's length. force: N, on the grip. wavelength: m, of the
    wrinkles along the edges (NaN where there are none), and amplitude: m, their root mean square,
    on the edge where it is larger. iterations: of Newton. seconds: of the solve, without building
    and compilation. points: (n, 1 + 2 m, 3) m, rachis point, leading and trailing barb nodes at
    the end. rest: the same at rest.
    """

    rachis_deflection: float
    barb_strain: float
    force: float
    wavelength: float
    amplitude: float
    iterations: int
    seconds: float
    points: Array
    rest: Array


def flat_kind(material: Material, guard: bool = False) -> FeatherKind:
    """The swan primary as a flat feather of 0.2 m, its vane of one of the three materials."""
    kind = feather_kind("swan_primary")
    return replace(
        kind,
        length=FEATHER_LENGTH,
        rachis=replace(
            kind.rachis,
            diameter_base=_WIDTH_BASE,
            diameter_tip=_WIDTH_TIP,
            taper=1.0,
            camber=0.0,
            sweep=0.0,
            twist=0.0,
        ),
        leading=_flat(kind.leading),
        trailing=_flat(kind.trailing),
        vane_material=replace(_VANES[material], compression_guard=_KAPPA if guard else 0.0),
        rachis_material=_RACHIS,
    )


def _flat(vane: VaneShape) -> VaneShape:
    return replace(vane, guides=tuple(replace(guide, camber=0.0) for guide in vane.guides))


def pull_feather(pull: FullPull, **vane: Any) -> PulledFeather:
    """Pull a feather. vane: other values of its vane's material. Raises SimulationError where no
    equilibrium is found."""
    kind = flat_kind(pull.material, pull.guard)
    kind = replace(kind, vane_material=replace(kind.vane_material, **vane))
    feather = build_feather(kind, pull.rows, pull.columns)
    solver, state = _solver(feather, kind, pull.nodal or pull.material != "barbs")
    node = _gripped(pull, feather)
    # kernels are loaded first, so that the measured time is that of the work
    solver.equilibrium(state, _loads(pull, feather, node, 0.0))
    begin = time.perf_counter()
    state, iterations = _pulled(pull, feather, node, solver, state)
    loads = _loads(pull, feather, node, 1.0, pushed=False)
    state, status, count = solver.equilibrium(state, loads)
    raise_if_failed(status, state.time, [pull.material])
    iterations += int(count[0])
    seconds = time.perf_counter() - begin
    points, rest = np.array(state.points.nodes[0]), feather.rest.nodes
    apart = loads.grip_end[0, 0] - points[node]
    wavelength, amplitude = wrinkles(feather, points)
    return PulledFeather(
        rachis_deflection=float(np.linalg.norm(points[-1, 0] - rest[-1, 0])) / FEATHER_LENGTH,
        barb_strain=barb_strain(feather, points),
        force=_GRIP_STIFFNESS * float(np.linalg.norm(apart)),
        wavelength=wavelength,
        amplitude=amplitude,
        iterations=iterations,
        seconds=seconds,
        points=points,
        rest=rest,
    )


def _pulled(
    pull: FullPull, feather: Feather, node: tuple[int, int], solver: Any, state: Any
) -> tuple[Any, int]:
    """State at the end of the pull, and Newton iterations; parts that find no rest are halved."""
    iterations, done = 0, 0.0
    part = 1.0 / pull.parts
    while done < 1.0 - 1e-9:
        next_done = min(1.0, done + part)
        new, status, count = solver.equilibrium(state, _loads(pull, feather, node, next_done))
        iterations += int(count[0])
        if status[0] == 0:
            state, done = new, next_done
            continue
        part *= 0.5
        if part < 0.5**_HALVINGS / pull.parts:
            raise_if_failed(status, state.time, [pull.material])
    return state, iterations


def _solver(feather: Feather, kind: FeatherKind, nodal: bool) -> tuple[Any, Any]:
    model = make_model([feather], [kind], 2)
    settings = Settings(newton=_SETTLED * FEATHER_LENGTH)
    root = np.zeros((1, 3)), np.eye(3)[None]
    if not nodal:
        return Solver(model, settings), rest_state(model, *root)
    bending: Literal["barbs", "hinges"] = (
        "barbs" if kind.vane_material.modulus_along_barbs > 1e8 else "hinges"
    )
    nodes = nodal_model(model, [feather], [kind], bending=bending)
    return NodalSolver(model, nodes, settings), nodal_rest_state(model, nodes, *root)


def _gripped(pull: FullPull, feather: Feather) -> tuple[int, int]:
    """Row and node that the grip holds: rachis tip, or edge of the trailing vane."""
    if pull.scene == "tip":
        return feather.rows - 1, 0
    return round(_SIDE_ROW * (feather.rows - 1)), 2 * feather.columns


def _loads(
    pull: FullPull, feather: Feather, node: tuple[int, int], done: float, pushed: bool = True
) -> Loads:
    rest = feather.rest.nodes
    start, aside = rest[node], done * pull.distance * FEATHER_LENGTH
    # what a cantilever that is bent by aside at its end falls short by: the rachis is not stretched
    target = start - np.array([0.6 * aside**2 / start[0], aside, 0.0])
    force = np.zeros((1, *rest.shape))
    count = 2 * feather.columns
    random = np.random.default_rng(_SEED).normal(size=(feather.rows, count))
    if pushed:
        force[0, :, 1:, 2] = _IMPERFECTION * random
    return no_loads(1)._replace(
        grip_node=np.array([[node]], dtype=np.int64),
        grip_start=target[None, None],
        grip_end=target[None, None],
        grip_stiffness=np.full((1, 1), _GRIP_STIFFNESS),
        force=force,
    )


def wrinkles(feather: Feather, points: Array) -> tuple[float, float]:
    """(wavelength, amplitude) in m of the wrinkles along the edges of the vane: see edge_waves.

    Of the edge that wrinkles more; the wavelength is NaN where the amplitude is below LEAST.
    """
    best = (float("nan"), 0.0)
    for side in range(2):
        rows = np.flatnonzero(feather.barb_length[side] > 0.0)
        last = (side + 1) * feather.columns
        edge = feather.rest.nodes[rows, last]
        arc = arc_lengths(edge)
        found = edge_waves(arc, points[rows, last, 2])
        if found[1] > best[1]:
            best = found
    return best if best[1] > MIN_WRINKLE else (float("nan"), best[1])


def edge_waves(arc: Array, height: Array) -> tuple[float, float]:
    """(wavelength, amplitude) in m of the waves in heights (k,) at arc lengths (k,).

    The heights, less the best cubic, resampled evenly; of their spectrum, what has at least _WAVES
    waves along the edge and at least four nodes a wave. The wavelength is that of its highest peak,
    the amplitude the root mean square of the heights in that band. (NaN, 0) where there is none.
    """
    count = 8 * len(arc)
    even = np.linspace(arc[0], arc[-1], count)
    values = CubicSpline(arc, height)(even)
    rest = values - np.polynomial.Polynomial.fit(even, values, 3)(even)
    spectrum = np.abs(np.fft.rfft(rest, _PADDING * count))
    frequency = np.fft.rfftfreq(_PADDING * count, even[1] - even[0])
    span = arc[-1] - arc[0]
    seen = np.where(
        (frequency > _WAVES / span) & (frequency < len(arc) / (4.0 * span)), spectrum, 0
    )
    if not seen.any():
        return float("nan"), 0.0
    # Parseval's sum over the one-sided spectrum
    power = 2.0 * float(np.sum(seen**2)) / (_PADDING * count * count)
    return 1.0 / float(frequency[int(np.argmax(seen))]), float(np.sqrt(power))
