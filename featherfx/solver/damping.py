"""Damping of materials: a loss that hardly depends on the frequency, or grows with it.

A material with a band of frequencies has branches of springs and dashpots,

    E*(w) = E (1 + sum_i g_i i w t_i / (1 + i w t_i)),      tan delta = Im E* / Re E*

(generalised Maxwell model). Its times t_i lie evenly on a logarithmic scale over the band of the
loss factor, a little beyond its ends; its weights g_i >= 0 are those of least squares for which
tan delta is the loss factor throughout the band. A loss d that does not depend on the frequency
stiffens: d ln E / d ln w = 2 / pi atan d, some 40 % from 1 to 200 Hz where d is 0.1. So moduli are
those of one frequency, the material's `reference_frequency`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.model import Model
from featherfx.phases import counted
from featherfx.solver.step.modes import first_frequency

Array = NDArray[np.float64]

# springs with dashpots beside the spring at rest
BRANCHES = 4
# decades beyond the band's ends at which the first and the last time lie: with it 0.1 from 1 to
# 200 Hz is met to 3 %, with 0 to 5 %, with 0.2 to 4 %
_DECADES_BEYOND = 0.1
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
def fit_branches(loss_factor: float, band: tuple[float, ...]) -> tuple[Array, Array]:
    """((B,) times s, (B,) weights) of a loss factor in a band of frequencies, Hz."""
    ends = 10.0 ** np.array([-_DECADES_BEYOND, _DECADES_BEYOND]) * band
    times = 1.0 / (2.0 * np.pi * np.geomspace(ends[0], ends[1], BRANCHES))
    turn = 2.0 * np.pi * np.geomspace(band[0], band[1], _FITTED_FREQUENCIES)[:, None] * times
    stored, lost = turn**2 / (1.0 + turn**2), turn / (1.0 + turn**2)
    weights, modulus = np.zeros(BRANCHES), np.ones(_FITTED_FREQUENCIES)
    for _ in range(_FIT_PASSES):
        some = np.ones(BRANCHES, dtype=np.bool_)
        while some.any():
            matrix = (lost - loss_factor * stored)[:, some] / modulus[:, None]
            weights = np.zeros(BRANCHES)
            weights[some] = np.linalg.lstsq(matrix, loss_factor / modulus, rcond=None)[0]
            if (weights >= 0.0).all():
                break
            some &= weights > 0.0
        modulus = 1.0 + stored @ weights
    return times, weights


def with_damping(model: Model, kinds: list[FeatherKind]) -> Model:
    """The model with the losses of its materials, and with moduli that hold at their frequencies.

    A material without a band gets a Kelvin-Voigt time, its loss factor over the feather's first
    angular frequency: faster vibrations lose more, slower ones less.
    """
    materials = [(kind.rachis_material, kind.vane_material) for kind in kinds]
    if any(each.loss_band for both in materials for each in both):
        model = _with_branches(model, materials)
    retardation = np.zeros((model.feathers, 2))
    known: dict[bytes, float] = {}
    for f, both in enumerate(counted("building", materials, len(kinds))):
        loss = np.array([0.0 if each.loss_band else each.loss_factor for each in both])
        if not loss.any():
            continue
        # of each alone, whoever else is there; rounded, so that of a mirror image it is the same
        key = b"".join(each.tobytes() for each in model.only(f).arrays().values())
        if key not in known:
            known[key] = float(f"{first_frequency(model, f):.5e}")
        retardation[f] = loss / known[key]
    return model._replace(retardation=retardation)


def _with_branches(model: Model, materials: list[tuple[RachisMaterial, VaneMaterial]]) -> Model:
    """The model with the Maxwell branches of materials that have a band."""
    fitted = [[_branches(each) for each in both] for both in materials]
    times, weights = np.ascontiguousarray(np.moveaxis(np.array(fitted), 2, 0))
    softer = np.array([[_softening(each) for each in both] for both in materials])
    found: dict[str, Any] = {}
    for name, part in _MODULI.items():
        values = getattr(model, name)
        found[name] = values * softer[:, part].reshape(-1, *[1] * (values.ndim - 1))
    hooks = model.hooks._replace(bounds=model.hooks.bounds * softer[:, 1:])
    return model._replace(relaxation_time=times, relaxation_weight=weights, hooks=hooks, **found)


def _branches(material: RachisMaterial | VaneMaterial) -> tuple[Array, Array]:
    """Times and weights of a material; without a band they hold nothing."""
    if not material.loss_band:
        return np.ones(BRANCHES), np.zeros(BRANCHES)
    return fit_branches(material.loss_factor, material.loss_band)


def _softening(material: RachisMaterial | VaneMaterial) -> float:
    """Modulus at rest over that at the material's reference frequency."""
    turn = 2j * np.pi * material.reference_frequency
    times, weights = _branches(material)
    return float(1.0 / (1.0 + (weights * turn * times / (1.0 + turn * times)).sum().real))
