"""Colours as displays show them and the light that they stand for (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array


def linear(colour: Array) -> Array:
    """Light of colours as displays show them."""
    low = colour <= 0.04045
    return np.where(low, colour / 12.92, ((np.maximum(colour, 0) + 0.055) / 1.055) ** 2.4)


def displayed(light: Array) -> Array:
    """Colours as displays show them of light, 0 to 1; undoes `linear`."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
