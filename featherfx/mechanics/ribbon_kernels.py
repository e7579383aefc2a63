"""Curling of a flat strip's section: from a thin rod to a developable ribbon.

    W = 1/2 K (1 - P) g^2 / b^2,      g = a^2 + nu b (b - b0)
    P = 2 (cosh c - cos c) / (c (sinh c + sin c)),      c = 2 (f b^2)^(1/4)
    f = 3/16 (1 - nu^2) w^4 / (h l)^2

a twist of an element of length l and b its bending about the strip's lateral axis, b0 at rest, rad;
w width, h thickness, nu Poisson's ratio, D bending modulus of the plate, K = D w / l. It comes on
top of the energy of a rod of the section w x h (rachis_kernels),

    1/2 K ((1 - nu^2) (b - b0)^2 + 2 (1 - nu) a^2)

Derivation: a strip bent to the curvature k from k0 and twisted by t per length may curl across, to
the height z(v). It has the plate's energy 1/2 D ((k - k0)^2 + z''^2 + 2 nu (k - k0) z'' +
2 (1 - nu) t^2), and curling stretches it along itself, 1/2 Y h e^2, e'' = t^2 - k z'', mean 0.
The least of both over all z with free edges is the sum of the energies above. Without twist this is
Lamb's beam that becomes a plate (1891). For a thick strip, c -> 0, P is 1 - c^4 / 180: a rod's. For
a thin one, c -> infinity, P is 0 and the sum is Sadowsky's energy of a developable strip (1930),

    W = 1/2 D w l [ (k^2 + t^2)^2 / k^2 - 2 k0 k (1 + nu (t / k)^2) + k0^2 ]

that of Charrondiere et al. 2019 with the slope t / k of the rulings, for a strip narrow beside its
length. Where k goes through zero that has a pole at any twist; here stretch takes its place.

(1 - P) / b^2 is f times 16 A(u) / B(u), u = c^4, A = sum 4 k u^(k-1) / (4 k + 2)!, k = 1, 2, ...,
B = sum u^k / (4 k + 1)!, k = 0, 1, ...: all terms are positive, so no digits are lost.
"""

from math import factorial, sqrt

import numpy as np

from featherfx.jit.compiled import kernel

# up to c = 30, where the next term is below rounding; beyond P is 2 / c to rounding
_TERMS, _LARGEST = 22, 30.0**4
_ABOVE = np.array([4.0 * k / factorial(4 * k + 2) for k in range(1, _TERMS + 1)])
_BELOW = np.array([1.0 / factorial(4 * k + 1) for k in range(_TERMS)])


@kernel
def _sum_of_powers(terms, u):
    """Sum of terms[k] u^k, and its first two derivatives by u."""
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(terms.shape[0] - 1, -1, -1):
        bend = bend * u + 2.0 * slope
        slope = slope * u + value
        value = value * u + terms[k]
    return value, slope, bend


@kernel
def curling(u):
    """(1 - P) / u and its first two derivatives by u = c^4."""
    if u > _LARGEST:
        root = 2.0 / sqrt(sqrt(u))
        square = u * u
        return (
            (1.0 - root) / u,
            (1.25 * root - 1.0) / square,
            (2.0 - 2.8125 * root) / (square * u),
        )
    a, a1, a2 = _sum_of_powers(_ABOVE, u)
    b, b1, b2 = _sum_of_powers(_BELOW, u)
    value = a / b
    slope = (a1 - value * b1) / b
    return value, slope, (a2 - 2.0 * slope * b1 - value * b2) / b


@kernel
def curl_energy(strain, rest, bending):
    """W of one element (J), and its derivatives by a, b, aa, ab and bb.

    strain: (6,) from rest. rest: (8,) v0 and p0 of the rachis, then nu and f. bending: N m, the
    rod's own against b.
    """
    poisson, flatness = rest[6], 16.0 * rest[7]
    if flatness == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    a, b = strain[3], strain[4] + rest[4]
    g, by_b = a * a + poisson * b * strain[4], poisson * (b + strain[4])
    s, slope, bend = curling(flatness * b * b)
    # S = (1 - P) / b^2 and its derivatives by b
    inner = 2.0 * flatness * b
    second = flatness * (2.0 * flatness * slope + inner * inner * bend)
    first, s = flatness * inner * slope, flatness * s
    k = bending / (1.0 - poisson * poisson)
    return (
        0.5 * k * s * g * g,
        2.0 * k * s * g * a,
        k * g * (s * by_b + 0.5 * first * g),
        2.0 * k * s * (g + 2.0 * a * a),
        2.0 * k * a * (first * g + s * by_b),
        k * (s * (by_b * by_b + 2.0 * poisson * g) + 2.0 * first * g * by_b + 0.5 * second * g * g),
    )


@kernel
def curls(model):
    """Return whether rachises of a model may be strips."""
    return model.rachis_rest.shape[2] > 6


@kernel
def curl_total(model, f, strains):
    """W of all elements of feather f (J); strains: (n-1, 6) from rest."""
    total = 0.0
    for i in range(strains.shape[0] if curls(model) else 0):
        total += curl_energy(strains[i], model.rachis_rest[f, i], model.rachis_stiffness[f, i, 4])[
            0
        ]
    return total


@kernel
def add_curl_stress(model, f, i, strain, stress):
    """Adds dW to the stress (6,) of element i."""
    if curls(model):
        w = curl_energy(strain, model.rachis_rest[f, i], model.rachis_stiffness[f, i, 4])
        stress[3] += w[1]
        stress[4] += w[2]


@kernel
def add_curl_stiffness(model, f, i, strain, whole, gradient, matrix):
    """Adds d2W to the lower part of element i's matrix (12, 12); gradient: (6, 12) of its strains.

    whole: else as much is added to both diagonals that with the rod's own stiffness it is definite.
    """
    if not curls(model):
        return
    stiffness = model.rachis_stiffness[f, i]
    w = curl_energy(strain, model.rachis_rest[f, i], stiffness[4])
    aa, ab, bb = w[3], w[4], w[5]
    if not whole:
        lowest = 0.5 * (aa + bb) - sqrt(0.25 * (aa - bb) ** 2 + ab * ab)
        if lowest < 0.0:
            aa, bb = aa - lowest, bb - lowest
    for k in range(12):
        to_a, to_b = aa * gradient[3, k] + ab * gradient[4, k], ab * gradient[3, k]
        to_b += bb * gradient[4, k]
        for m in range(k + 1):
            matrix[k, m] += to_a * gradient[3, m] + to_b * gradient[4, m]
