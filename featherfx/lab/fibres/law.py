"""A membrane of fibres of all directions, each of which hardens, yields and breaks.

    w = a (exp[b (I - 3)] - 1),   I = C + 2 / sqrt(C)                     elastic, per volume
    s(C) = 2 a b exp[b (I - 3)] (1 - C^(-3/2))                            its stress, 2 dw/dC
    S_ij = 1/Q int s(C_f) n_i n_j R(t) dt,   C_f = n.C n,  n = (cos t, sin t)

C is the square of a fibre's stretch; fibres are incompressible. Beyond the critical C_c its stress
stays s(C_c); unloaded, it falls by the slope of the elastic law; at the release C_r it breaks. R is
a normal distribution of fibres about the mean direction, cut at a right angle to either side, Q its
integral. Source: Jacquemoud 2007, eq. 4-15, 4-27 to 4-31, 4-38 and 4-83; in her eq. 4-25
the exponent 3/2 has the wrong sign, in 4-27 the right one (here -3/2 follows from w by S_22 = 0).
Unloading is that of her section 4.4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# fitted to the test RHD14 of human skin (section 4.5.1.2)
STIFFNESS, EXPONENT = 0.5289e6, 14.1395


@dataclass(frozen=True)
class Fibre:
    """critical, release: C_c and C_r, squares of stretches. stiffness: a, Pa. exponent: b."""

    critical: float
    release: float
    stiffness: float = STIFFNESS
    exponent: float = EXPONENT

    @property
    def plateau(self) -> float:
        """Stress between C_c and C_r, Pa."""
        return float(self.elastic(np.array(self.critical))[0])

    def elastic(self, square: Array) -> tuple[Array, Array]:
        """s (Pa) and ds/dC of squares of stretches, of any shape."""
        a, b = self.stiffness, self.exponent
        turned = 1.0 - square**-1.5
        growth = a * b * np.exp(b * (square + 2.0 / np.sqrt(square) - 3.0))
        return 2.0 * growth * turned, growth * (2.0 * b * turned**2 + 3.0 * square**-2.5)

    def response(self, square: Array, largest: Array) -> tuple[Array, Array]:
        """Stress (Pa) and its slope; largest: C that the fibre has seen, this one included."""
        stress, slope = self.elastic(square)
        slipped = largest > self.critical
        stress[slipped] -= self.elastic(largest[slipped])[0] - self.plateau
        slope[slipped & (square >= largest)] = 0.0
        whole = largest < self.release
        return np.where(whole, stress, 0.0), np.where(whole, slope, 0.0)


@dataclass(frozen=True)
class Directions:
    """T fibres by direction at each of G points.

    weight: (G, T), R dt / Q; sums to one. parts: (G, T, 3), those of S_11, S_22 and S_12 in a
    fibre's stress, which are those of E_11, E_22 and 2 E_12 in its strain, too.
    """

    weight: Array
    parts: Array


def directions(mean: Array, deviation: float, count: int) -> Directions:
    """T = count fibres at each of G points; mean: (G,) rad, deviation: rad, of R."""
    offset = (np.arange(count) + 0.5) * (np.pi / count) - 0.5 * np.pi
    weight = np.exp(-0.5 * (offset / deviation) ** 2)
    angle = mean[:, None] + offset
    cosine, sine = np.cos(angle), np.sin(angle)
    parts = np.stack([cosine**2, sine**2, cosine * sine], axis=-1)
    return Directions(np.broadcast_to(weight / weight.sum(), angle.shape), parts)


@dataclass(frozen=True)
class MembraneResponse:
    """stress: (G, 3) Pa, (S_11, S_22, S_12). tangent: (G, 3, 3) Pa, by (E_11, E_22, 2 E_12).
    largest: (G, T), C of every fibre's past. intact: (G,) share of fibres that are whole."""

    stress: Array
    tangent: Array
    largest: Array
    intact: Array


def membrane_response(
    fibre: Fibre, fibres: Directions, strain: Array, largest: Array
) -> MembraneResponse:
    """The membrane under strain (G, 3), Green-Lagrange (E_11, E_22, 2 E_12).

    largest: (G, T), 1 at first. Nothing that is given is changed.
    """
    square = 1.0 + 2.0 * np.einsum("gtk,gk->gt", fibres.parts, strain)
    seen = np.maximum(largest, square)
    stress, slope = fibre.response(square, seen)
    by_direction = np.swapaxes(fibres.parts, 1, 2)
    stiff = by_direction * (slope * fibres.weight)[:, None]
    return MembraneResponse(
        stress=(by_direction @ (stress * fibres.weight)[..., None])[..., 0],
        tangent=2.0 * (stiff @ fibres.parts),
        largest=seen,
        intact=np.sum(fibres.weight, axis=1, where=seen < fibre.release),
    )
