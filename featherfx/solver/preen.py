"""Gaps between barbs that are closed again: strokes of a beak, and hooks that find each other.

A gap that is closed by a share c of what is open gets that much of its strength back,

    h' = h + c (1 - h),    p' = (1 - c) p,    level' = 1 + (1 - c) (level - 1)

h hooks, p slip of vane_hook_kernels. An open one first takes its strains as its slip, so that it
hooks without stress. Where p' would leave it with more than _HELD_FRACTION of its strength, it
keeps as much slip as that takes: what is pulled apart as it is closed would open again at once. The
energy that this puts into the vane is work of the beak. Only gaps whose edges are within reach are
closed:

    (J - 1) / (1 / h_0) <= reach

J the ratio of areas of vane_guard_kernels, 1 / h_0 that of the triangle's height at rest.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.mechanics.model import Gaps, Model
from featherfx.solver.state import State
from featherfx.solver.step.gap_kernels import HEALED_LENGTH, LOOSE_FRACTION, PREENING_WORK

# part of its strength that a gap may bear when it is closed
_HELD_FRACTION = 0.5
# smallest square of J
_FLAT = 1e-6


def close_gaps(
    model: Model, state: State, feather: int, touched: Flags, fraction: float, reach: float
) -> Gaps | None:
    """Gaps of a feather of a state after some of them are closed; None where none is.

    touched: (2, n-1, m, 2) triangles that are looked at. fraction: c, above 0 to 1. reach: m. The
    state is not changed.
    """
    gaps, hooks = state.gaps_of(feather), model.hooks
    strain, stiffness = state.strains.cell[feather, 0], model.cell_stiffness[feather]
    slipped = (gaps.hooked < 1.0) | (gaps.level > 1.0) | gaps.slip.any(axis=-1)
    chosen = touched & slipped & (stiffness[..., 0] > 0.0) & (hooks.limit[feather, ..., 0] > 0.0)
    square = np.maximum(1.0 + 2.0 * strain[..., 0] - strain[..., 1] ** 2, _FLAT)
    chosen &= np.sqrt(square) - 1.0 <= reach * model.cell_rest[feather, ..., 2] + 1e-12
    if not chosen.any():
        return None
    new = Gaps(*(array.copy() for array in gaps))
    x, k, y = strain[chosen], stiffness[chosen], hooks.limit[feather][chosen]
    was_open = gaps.hooked[chosen] == 0.0
    hooked = gaps.hooked[chosen] + fraction * (1.0 - gaps.hooked[chosen])
    hooked[hooked > 1.0 - LOOSE_FRACTION] = 1.0
    level = np.where(was_open, 1.0, 1.0 + (1.0 - fraction) * (gaps.level[chosen] - 1.0))
    before = np.where(was_open[:, None], x, gaps.slip[chosen])
    slip = (1.0 - fraction) * before
    stress = k * (x - slip)
    borne = np.hypot(np.maximum(stress[:, 0], 0.0) / y[:, 0], stress[:, 1] / y[:, 1])
    much = borne / (_HELD_FRACTION * hooked * level)
    slip = np.where(much[:, None] > 1.0, x - (x - slip) / np.maximum(much, 1.0)[:, None], slip)
    work = 0.5 * np.sum(k * ((x - slip) ** 2 - (x - before) ** 2))
    new.hooked[chosen], new.level[chosen], new.slip[chosen] = hooked, level, slip
    new.spent[PREENING_WORK] += work
    # m, length of a gap that each triangle stands for
    own = np.stack([model.segment[feather, :, :-1], model.segment[feather, :, 1:]], axis=-1)
    half = np.broadcast_to(0.5 * own[:, :, None], hooks.growth[feather].shape)
    new.length[HEALED_LENGTH] += half[chosen] @ (hooked - gaps.hooked[chosen])
    return new
