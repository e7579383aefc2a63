"""Damping of materials: a loss that hardly depends on the frequency.

A material has branches of springs and dashpots, and a dashpot alone for what is faster than them,

    E*(w) = E (1 + i w t + sum_i g_i i w t_i / (1 + i w t_i)),      tan delta = Im E* / Re E*

(generalised Maxwell model). Its times t_i lie evenly on a logarithmic scale over the band of the
loss factor; t and its weights g_i >= 0 are those of least squares for which tan delta is the loss
factor throughout the band. Beyond it the loss goes on to grow, so that what is too fast to be seen
ends soon. A loss d that does not depend on the frequency stiffens: d ln E / d ln w = 2 / pi atan d,
some 50 % from rest to 200 Hz where d is 0.1. So moduli are those of one frequency, the material's
`reference_frequency`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.model import Model

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
