"""Natural frequencies about the rest shape, and the damping times that follow from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.types import FeatherKind
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.phases import counted
from featherfx.solver.scratch import SolverScratch, make_scratch
from featherfx.solver.state import State, rest_state
from featherfx.solver.types import STABILISING_STIFFNESS, IntegratorFactors, panel_shape

Array = NDArray[np.float64]

air_kernels = KernelModule("featherfx.mechanics.air_kernels")
assembly_kernels = KernelModule("featherfx.solver.step.assembly_kernels")
banded_kernels = KernelModule("featherfx.solver.step.banded_kernels")
newton_kernels = KernelModule("featherfx.solver.step.newton_kernels")
pose_kernels = KernelModule("featherfx.solver.step.pose_kernels")

_STIFFNESSES = (
    "rachis_stiffness", "barb_stiffness", "cell_stiffness", "hinge_stiffness", "twist_stiffness",
)  # fmt: skip

# unknowns up to which all modes are found at once; the Krylov space of few unknowns breaks down
_MAX_DENSE_UNKNOWNS = 120


def rest_bands(model: Model, feather: int, air_density: float = 0.0) -> tuple[Array, Array]:
    """Stiffness and mass of one feather at rest as lower bands (N, B + 1) of the coordinates.

    The six coordinates of a held root have unit stiffness and no mass. air_density: kg/m^3, of
    still air that it carries along.
    """
    # nothing here may take time for the others, or a batch would take the square of their number
    model = model.only(feather)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    weightless = {name: np.zeros_like(getattr(model, name)) for name in _STIFFNESSES}
    work = make_scratch(model)
    loads = no_loads(1)
    stiffness = _band(model, loads, 0.0, state, work)
    loads = loads._replace(air=np.array([air_density, 0.0, 0.0, 0.0]), added_mass=np.ones(1))
    nodes, still = state.points.nodes[0], state.velocity.nodes[0]
    air_kernels.carried_energy(model, loads, 0, nodes, still, work.around)
    mass = _band(model._replace(**weightless), loads, 1.0, state, work)
    if model.held[0]:
        mass[:6, 0] = 0.0
    return stiffness, mass


def _band(model: Model, loads: Loads, inertia: float, state: State, work: SolverScratch) -> Array:
    """Stiffness plus inertia (1/s^2) times mass of the pose of a model's only feather."""
    f, factors, now = 0, IntegratorFactors(inertia, 0.0, 0.0), work.now
    pose_kernels.load_pose(model, f, state, now)
    newton_kernels.evaluate(model, loads, f, 0.0, factors, now, work.around)
    assembly_kernels.assemble(model, loads, f, 0.0, factors, STABILISING_STIFFNESS, 0.0, work)
    return work.system.band.copy()


def first_frequency(model: Model, feather: int) -> float:
    """Lowest natural angular frequency (rad/s) of one held feather, by inverse iteration."""
    stiffness, mass = rest_bands(model, feather)
    size, width = stiffness.shape
    scratch = np.zeros_like(stiffness), np.zeros(panel_shape(width))
    quotient = banded_kernels.lowest_quotient(
        stiffness, mass, *scratch, np.ones(size), np.zeros(size)
    )
    if not quotient > 0.0:
        raise np.linalg.LinAlgError("the stiffness at rest is not positive definite")
    return float(np.sqrt(quotient))


def frequencies(model: Model, feather: int, count: int, air_density: float = 0.0) -> Array:
    """(count,) lowest natural frequencies of one held feather, Hz, ascending."""
    return natural_modes(model, feather, count, air_density)[0]


def decrements(model: Model, feather: int, count: int, air_density: float = 0.0) -> Array:
    """(count,) logarithmic decrements of the lowest modes, by their damping alone.

    A mode u of angular frequency w has the loss factor w sum(t u.K u) / u.K u over the rachis and
    the vane, K stiffness and t retardation of each; half of it is z, and the decrement is
    2 pi z / (1 - z^2)^(1/2), infinite where the mode does not swing.
    """
    found, shapes = natural_modes(model, feather, count, air_density)
    rest, own = model.only(feather), model.retardation[feather]
    vane = {name: np.zeros_like(getattr(rest, name)) for name in _STIFFNESSES[1:]}
    whole, rachis = (_sparse(rest_bands(each, 0)[0]) for each in (rest, rest._replace(**vane)))
    lost = own[1] * whole + (own[0] - own[1]) * rachis
    loss = [u @ (lost @ u) / (u @ (whole @ u)) for u in shapes.T]
    half = np.pi * found * np.array(loss)
    swinging = half < 1.0
    root = np.sqrt(1.0 - np.where(swinging, half, 0.0) ** 2)
    return np.where(swinging, 2.0 * np.pi * half / root, np.inf)


def natural_modes(
    model: Model, feather: int, count: int, air_density: float = 0.0
) -> tuple[Array, Array]:
    """((count,) lowest natural frequencies of one held feather, Hz, (N, count) their shapes)."""
    bands = rest_bands(model, feather, air_density)
    stiffness, mass = (_sparse(band) for band in bands)
    size = mass.shape[0]
    if size <= _MAX_DENSE_UNKNOWNS:
        from scipy.linalg import eigh

        # compliance rather than stiffness, so that rounding is a part of the lowest mode's
        last = (size - count, size - 1)
        flexible, shapes = eigh(mass.toarray(), stiffness.toarray(), subset_by_index=last)
        return 1.0 / (2.0 * np.pi * np.sqrt(flexible[::-1])), shapes[:, ::-1]
    from scipy.sparse.linalg import eigsh  # heavy, and only for this

    values, shapes = eigsh(stiffness, count, mass, sigma=0.0, v0=np.ones(mass.shape[0]))
    order = np.argsort(values)
    return np.sqrt(values[order]) / (2.0 * np.pi), shapes[:, order]


def _sparse(band: Array):
    from scipy.sparse import diags_array

    size, width = band.shape
    lower = [band[: size - d, d] for d in range(min(width, size))]
    offsets = [-d for d in range(len(lower))]
    upper = lower[1:]
    return diags_array(lower + upper, offsets=offsets + [-o for o in offsets[1:]]).tocsc()


def with_damping(model: Model, kinds: list[FeatherKind]) -> Model:
    """The model with Kelvin-Voigt times: loss factor over the feather's first frequency.

    A vibration at the first frequency then loses 2 pi times the loss factor of its energy per
    period (logarithmic decrement pi times the loss factor); slower ones less, faster ones more.
    """
    retardation = np.zeros((model.feathers, 2))
    known: dict[bytes, float] = {}
    for f, kind in enumerate(counted("building", kinds, len(kinds))):
        loss = (kind.rachis_material.loss_factor, kind.vane_material.loss_factor)
        if max(loss) == 0.0:
            continue
        # of each alone, whoever else is there; rounded, so that of a mirror image it is the same
        key = b"".join(each.tobytes() for each in model.only(f).arrays().values())
        if key not in known:
            known[key] = float(f"{first_frequency(model, f):.5e}")
        retardation[f] = np.array(loss) / known[key]
    return model._replace(retardation=retardation)
