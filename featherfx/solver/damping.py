"""Damping of materials: a loss that hardly depends on the frequency.

A material has branches of springs and dashpots, and a dashpot alone for what is faster than them,

    E*(w) = E (1 + i w t + sum_i g_i i w t_i / (1 + i w t_i)),      tan delta = Im E* / Re E*

(generalised Maxwell model). Its times t_i lie evenly on a logarithmic scale over the band of the
loss factor; t and its weights g_i >= 0 are those of least squares for which tan delta is the loss
factor throughout the band. Beyond it the loss goes on to grow, so that what is too fast to be seen
ends soon. A loss d that does not depend on the frequency stiffens: d ln E / d ln w = 2 / pi atan d,
some 50 % from rest to 200 Hz where d is 0.1. So moduli are those of one frequency, the material's
`reference_frequency`.

Natural frequencies about the rest shape, and the vibrations of damped modes.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.solver.scratch import SolverScratch, make_scratch
from featherfx.solver.state import State, rest_state
from featherfx.solver.types import STABILISING_STIFFNESS, IntegratorFactors, panel_shape

# springs with dashpots beside the spring at rest
BRANCHES = 3
# decades below the highest frequency at which the last time lies: with it 0.1 from 1 to 200 Hz is
# met to 5 %, from 1 to 300 Hz to 7 %
_DECADES_WITHIN = 0.42
# frequencies of the least squares; passes, each weighed by the moduli of the one before
_FITTED_FREQUENCIES, _FIT_PASSES = 60, 10
# arrays of a model that are moduli: of the rachis (0) or the vane (1)
_MODULI = {
    "rachis_stiffness": 0,
    "barb_stiffness": 1,
    "cell_stiffness": 1,
    "hinge_stiffness": 1,
    "twist_stiffness": 1,
}


@cache
def fit_branches(loss_factor: float, band: tuple[float, ...]) -> tuple[float, Array, Array]:
    """Time of the dashpot, (B,) times of the branches, s, and (B,) their weights, of a loss factor
    in a band of frequencies, Hz."""
    last = band[1] * 10.0**-_DECADES_WITHIN
    times = 1.0 / (2.0 * np.pi * np.geomspace(band[0], max(last, band[0]), BRANCHES))
    angular = 2.0 * np.pi * np.geomspace(band[0], band[1], _FITTED_FREQUENCIES)[:, None]
    turn, alone = angular * times, angular / angular[-1]
    stored = np.hstack([turn**2 / (1.0 + turn**2), np.zeros_like(alone)])
    lost = np.hstack([turn / (1.0 + turn**2), alone])
    weights, modulus = np.zeros(BRANCHES + 1), np.ones(_FITTED_FREQUENCIES)
    for _ in range(_FIT_PASSES):
        some = np.ones(BRANCHES + 1, dtype=np.bool_)
        while some.any():
            matrix = (lost - loss_factor * stored)[:, some] / modulus[:, None]
            weights = np.zeros(BRANCHES + 1)
            weights[some] = np.linalg.lstsq(matrix, loss_factor / modulus, rcond=None)[0]
            if (weights >= 0.0).all():
                break
            some &= weights > 0.0
        modulus = 1.0 + stored @ weights
    return float(weights[-1] / angular[-1, 0]), times, weights[:-1]


def with_damping(model: Model, kinds: list[FeatherKind]) -> Model:
    """The model with the losses of its materials and with moduli that hold at their frequencies."""
    materials = [(kind.rachis_material, kind.vane_material) for kind in kinds]
    fitted = [
        [fit_branches(each.loss_factor, each.loss_band) for each in both] for both in materials
    ]
    retardation, times, weights = (
        np.array([[each[k] for each in both] for both in fitted]) for k in range(3)
    )
    softer = np.array([[softening(each) for each in both] for both in materials])
    found: dict[str, Any] = {}
    for name, part in _MODULI.items():
        values = getattr(model, name)
        found[name] = values * softer[:, part].reshape(-1, *[1] * (values.ndim - 1))
    found["hooks"] = model.hooks._replace(bounds=model.hooks.bounds * softer[:, 1:])
    return model._replace(
        retardation=retardation, relaxation_time=times, relaxation_weight=weights, **found
    )


def softening(material: RachisMaterial | VaneMaterial) -> float:
    """Return the modulus at rest over that at the material's reference frequency."""
    turn = 2j * np.pi * material.reference_frequency
    _, times, weights = fit_branches(material.loss_factor, material.loss_band)
    return float(1.0 / (1.0 + (weights * turn * times / (1.0 + turn * times)).sum().real))


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
# of a damped mode, whose frequency each brings nearer by about the loss factor
_MAX_MODE_ITERATIONS = 50


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
    f, factors, now = 0, IntegratorFactors(inertia, 0.0), work.now
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


class DampedModes(NamedTuple):
    """Damped vibrations of the lowest modes. frequencies: (count,) Hz. decrements: (count,)
    logarithmic decrements, of the loss of materials alone; infinite where a mode does not swing."""

    frequencies: Array
    decrements: Array


def damped_modes(model: Model, feather: int, count: int, air_density: float = 0.0) -> DampedModes:
    """Vibrations exp(p t) of the lowest modes of one held feather.

    Of a mode u of angular frequency w at rest, with K the stiffness of each part,

        p^2 + w^2 (1 + t p + sum_i g_i p t_i / (1 + p t_i)) = 0

    with t and g_i the means of rachis and vane, weighed by u.K u; shapes are those at rest. The
    frequency is |p| / 2 pi.
    """
    found, shapes = natural_modes(model, feather, count, air_density)
    rest = model.only(feather)
    vane = {name: np.zeros_like(getattr(rest, name)) for name in _STIFFNESSES[1:]}
    whole, rachis = (_sparse(rest_bands(each, 0)[0]) for each in (rest, rest._replace(**vane)))
    share = np.array([(u @ (rachis @ u)) / (u @ (whole @ u)) for u in shapes.T])
    times, weights = rest.relaxation_time[0], rest.relaxation_weight[0]
    parts, square = np.stack([share, 1.0 - share], axis=1), (2.0 * np.pi * found) ** 2
    half = 0.5 * square * (parts @ rest.retardation[0])
    p = 2j * np.pi * found
    for _ in range(_MAX_MODE_ITERATIONS if times.size else 1):
        turn = p[:, None, None] * times
        stiffer = (parts * (weights * turn / (1.0 + turn)).sum(axis=2)).sum(axis=1)
        root = np.sqrt(half**2 - square * (1.0 + stiffer))
        p = np.where(root.imag < 0.0, -root, root) - half
    swings = p.imag > 0.0
    period = np.where(swings, p.imag, 1.0)
    decrement = np.where(swings, 2.0 * np.pi * np.abs(p.real) / period, np.inf)
    return DampedModes(np.abs(p) / (2.0 * np.pi), decrement)


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
