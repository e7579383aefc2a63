"""Arrays of rotations at rest: matrices, unit quaternions (w, x, y, z), rotation vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frames_to_turns(frames: Array) -> Array:
    """(..., 3, 3) rotation matrices to (..., 4) unit quaternions."""
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_matrix(frames.reshape(-1, 3, 3)).as_quat()
    return np.roll(flat, 1, axis=-1).reshape(*frames.shape[:-2], 4)


def turns_to_frames(turns: Array) -> Array:
    """(..., 4) unit quaternions to (..., 3, 3) rotation matrices."""
    from scipy.spatial.transform import Rotation

    flat = np.roll(turns.reshape(-1, 4), -1, axis=-1)
    return Rotation.from_quat(flat).as_matrix().reshape(*turns.shape[:-1], 3, 3)


def rotation_vectors(frames: Array) -> Array:
    """(..., 3, 3) rotation matrices to (..., 3) rotation vectors, rad."""
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_matrix(frames.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*frames.shape[:-2], 3)


def along_rows(turns: Array) -> Array:
    """(..., n, 4) quaternions with the signs that are nearest to those of the row before.

    Rows whose signs do not belong together would count as turned by 2 pi against each other
    (featherfx/mechanics/rachis_kernels.py).
    """
    close = np.einsum("...nk,...nk->...n", turns[..., 1:, :], turns[..., :-1, :])
    sign = np.cumprod(np.where(close < 0.0, -1.0, 1.0), axis=-1)
    return np.concatenate([turns[..., :1, :], turns[..., 1:, :] * sign[..., None]], axis=-2)
