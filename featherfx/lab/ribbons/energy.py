"""Elastic energy of a ribbon: a thin developable strip, much stiffer within its plane than across.

    E = sum over elements of 1/2 D w integral [ H(x) c^2 (1 + t^2)^2 - 2 k c (1 + nu t^2) + k^2 ] ds
    H(x) = artanh(x) / x,  x = w t' / 2,  |x| < 1

D flexural rigidity of the plate (N m), w width, s arc length of the centreline, c its normal
curvature (1/m), t the tangent of the angle of the straight lines that rule the strip from its
width, k the rest curvature, nu Poisson's ratio. The strip is developable and its edges straight, so
its geodesic curvature is 0 and its torsion t c: unknowns are c and t, which stay defined where the
curvature changes sign; t alone is undetermined there, and weighs nothing. Both are continuous, and
polynomials of the ribbon's degree on each element, by their values at evenly spaced nodes.

Derivation: the only principal curvature is K = c (1 + t^2) on the centreline and K / (1 + v t')
at distance v along a ruling, whose area element is (1 + v t') dv ds. Integrated over the width, the
plate's energy against a rest curvature k along the strip gives the above. It diverges where
rulings meet at an edge, x = 1 or -1. Wunderlich 1962; H = 1 is Sadowsky's energy of 1930, the
limit of a narrow strip. In the form of Charrondiere et al. 2019, with the constant k^2 that makes
the rest shape's energy 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import Problem, require
from featherfx.lab.declare import NOT_NEGATIVE, POSITIVE, Range, out_of_range, value

_SERIES, _TERMS = 0.1, 9


@dataclass(frozen=True)
class Ribbon:
    """A strip of constant thickness, clamped at one end; its width may taper linearly.

    rest_curvature: constant, or (N,) at the nodes, N = elements degree + 1. elements: pieces with
    polynomials as curvature and ruling. grading: the stations are at length (i / elements)^grading;
    above 1 they crowd at the clamp, where a strip bends that hangs under a large weight.
    finite_width: False for the limit of Sadowsky.
    """

    length: float = value("m.", allowed=POSITIVE)
    width: float = value("m.", allowed=POSITIVE)
    rigidity: float = value("N m, of the plate: Y h^3 / (12 (1 - nu^2)).", allowed=POSITIVE)
    surface_density: float = value("kg/m^2.", allowed=NOT_NEGATIVE, option="density")
    rest_curvature: float | Array = value("1/m.", 0.0)
    poisson: float = value("Poisson's ratio.", 0.5, Range(0.0, 0.5))
    tip_width: float | None = value(
        "m, the width tapers linearly.  [default: width]", None, POSITIVE
    )
    elements: int = value("Of the ribbon.", 20, Range(1, 1000))
    grading: float = value("Above 1: finer at the clamp.", 1.0, Range(1.0, 5.0))
    finite_width: bool = True
    series: bool = value("Integrate by power series, not by rigid links.", False)
    degree: int = value("Of curvature and ruling on an element.", 1, Range(1, 3))

    def __post_init__(self) -> None:
        problems = out_of_range(self, "ribbon")
        shape = np.shape(self.rest_curvature)
        if not np.isfinite(self.rest_curvature).all():
            text = "not a finite number. Give any finite number"
            problems.append(Problem("ribbon", "rest_curvature", text))
        if shape not in ((), (self.nodes,)):
            text = f"shape {shape} is not allowed. Give one number or {self.nodes}"
            problems.append(Problem("ribbon", "rest_curvature", text))
        require(*problems)

    @property
    def stations(self) -> Array:
        """(elements + 1,) m, arc lengths at which elements meet."""
        return self.length * np.linspace(0.0, 1.0, self.elements + 1) ** self.grading

    @property
    def nodes(self) -> int:
        """N, places at which the unknowns are given."""
        return self.elements * self.degree + 1

    @property
    def node_stations(self) -> Array:
        """(N,) m, arc lengths of the nodes."""
        place = np.arange(self.nodes) / self.degree
        return np.interp(place, np.arange(self.elements + 1), self.stations)

    @property
    def rest(self) -> Array:
        """(2 N,) unknowns of the rest shape: its curvature, and rulings across."""
        curvature = np.broadcast_to(self.rest_curvature, (self.nodes,))
        return np.concatenate([curvature, np.zeros(self.nodes)])

    def own_nodes(self) -> Indices:
        """(elements, degree + 1) nodes of each element."""
        first = self.degree * np.arange(self.elements)
        return first[:, None] + np.arange(self.degree + 1)

    def width_at(self, station: Array) -> Array:
        """Width (m) at arc lengths (m)."""
        tip = self.width if self.tip_width is None else self.tip_width
        return self.width + (tip - self.width) * station / self.length


def width_factor(x: Array) -> tuple[Array, Array, Array]:
    """H(x) = artanh(x) / x and its first two derivatives; |x| below 1."""
    near = np.abs(x) < _SERIES
    far = np.where(near, 0.5, x)
    square = 1.0 - far**2
    value = np.arctanh(far) / far
    first = (1.0 / square - value) / far
    second = 2.0 * (far / square**2 - first) / far
    small = np.where(near, x, 0.0)
    # artanh(x) / x = sum of x^2k / (2 k + 1)
    k = np.arange(_TERMS)[:, None]
    powers = small[None] ** (2 * k)
    series = (powers / (2 * k + 1)).sum(0)
    once = (2 * k[1:] * small[None] ** (2 * k[1:] - 1) / (2 * k[1:] + 1)).sum(0)
    twice = (2 * k[1:] * (2 * k[1:] - 1) * small[None] ** (2 * k[1:] - 2) / (2 * k[1:] + 1)).sum(0)
    return (
        np.where(near, series, value),
        np.where(near, once, first),
        np.where(near, twice, second),
    )


@lru_cache
def monomials(degree: int) -> Array:
    """(D, D) coefficients, by powers of the place 0 to 1 on an element, of the polynomials that are
    1 at one of its D = degree + 1 evenly spaced nodes; a column each."""
    powers = np.vander(np.linspace(0.0, 1.0, degree + 1), increasing=True)
    return np.asarray(np.linalg.inv(powers), dtype=float)


def values_at(degree: int, places: Array) -> Array:
    """(K, D) of these polynomials at places (K,) of an element."""
    return np.vander(places, degree + 1, increasing=True) @ monomials(degree)


def slopes_at(degree: int, places: Array) -> Array:
    """(K, D) of their derivatives by the place."""
    powers = np.arange(1, degree + 1)
    return np.vander(places, degree, increasing=True) @ (powers[:, None] * monomials(degree)[1:])


@lru_cache
def points_on(degree: int) -> tuple[Array, Array]:
    """Places (K,) and weights of the elastic energy: they integrate c^2 (1 + t^2)^2 exactly."""
    points, weights = np.polynomial.legendre.leggauss(3 * degree + 1)
    return 0.5 + 0.5 * points, 0.5 * weights


def _along(ribbon: Ribbon, places: Array) -> Array:
    """(elements, K) m, arc lengths of places on all elements."""
    return ribbon.stations[:-1, None] + np.diff(ribbon.stations)[:, None] * places


def closeness(ribbon: Ribbon, unknowns: Array) -> Array:
    """(elements, K) x of the width factor at points of elements and their ends: rulings meet at an
    edge where it reaches 1 or -1."""
    ends = np.concatenate([[0.0], points_on(ribbon.degree)[0], [1.0]])
    ruling = unknowns[ribbon.nodes :][ribbon.own_nodes()]
    half = 0.5 * ribbon.width_at(_along(ribbon, ends))
    slope = ruling @ slopes_at(ribbon.degree, ends).T / np.diff(ribbon.stations)[:, None]
    return np.asarray(half * slope)


def elastic(ribbon: Ribbon, unknowns: Array) -> tuple[float, Array, Array]:
    """Energy (J), gradient (U,) and Hessian (U, U) at unknowns (U,): c, then t at all nodes.

    The energy is infinite, with gradient and Hessian of zeros, where rulings meet at an edge.
    """
    count, size, own = ribbon.elements, ribbon.nodes, ribbon.own_nodes()
    gradient, matrix = np.zeros(2 * size), np.zeros((2 * size, 2 * size))
    x = closeness(ribbon, unknowns)
    if ribbon.finite_width and not (np.abs(x) < 1.0).all():
        return np.inf, gradient, matrix
    step, (points, weights) = np.diff(ribbon.stations), points_on(ribbon.degree)
    width = ribbon.width_at(_along(ribbon, points))
    # by element: (value, gradient, Hessian) in (c, t, x) at a point, then in its unknowns
    energy, each = 0.0, ribbon.degree + 1
    blocks, lines = np.zeros((count, 2 * each, 2 * each)), np.zeros((count, 2 * each))
    shapes, slopes = values_at(ribbon.degree, points), slopes_at(ribbon.degree, points)
    rest = ribbon.rest[:size][own]
    curvature, ruling = unknowns[:size][own], unknowns[size:][own]
    for k, (shape, weight) in enumerate(zip(shapes, weights, strict=True)):
        at = x[:, k + 1]
        factor = width_factor(at) if ribbon.finite_width else (np.ones(count), 0.0 * at, 0.0 * at)
        local = curvature @ shape, ruling @ shape, rest @ shape
        value, slope, bend = _density(*local, ribbon.poisson, factor)
        scale = 0.5 * ribbon.rigidity * width[:, k] * step * weight
        to = np.zeros((count, 3, 2 * each))
        to[:, 0, :each] = to[:, 1, each:] = shape
        to[:, 2, each:] = 0.5 * (width[:, k] / step)[:, None] * slopes[k]
        energy += float(scale @ value)
        lines += scale[:, None] * np.einsum("ea,eab->eb", slope, to)
        blocks += scale[:, None, None] * np.einsum("eab,eac,ecd->ebd", to, bend, to)
    places = np.concatenate([own, size + own], axis=1)
    np.add.at(gradient, places, lines)
    np.add.at(matrix, (places[:, :, None], places[:, None, :]), blocks)
    return energy, gradient, matrix


def _density(
    c: Array, t: Array, k: Array, poisson: float, factor: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """H c^2 (1 + t^2)^2 - 2 k c (1 + nu t^2) + k^2 with its derivatives by (c, t, x)."""
    width, first, second = factor
    wide = 1.0 + t**2
    bent = (c * wide) ** 2
    value = width * bent - 2.0 * k * c * (1.0 + poisson * t**2) + k**2
    slope = np.stack(
        [
            2.0 * width * c * wide**2 - 2.0 * k * (1.0 + poisson * t**2),
            4.0 * width * c**2 * wide * t - 4.0 * poisson * k * c * t,
            first * bent,
        ],
        axis=1,
    )
    bend = np.empty((len(c), 3, 3))
    bend[:, 0, 0] = 2.0 * width * wide**2
    bend[:, 1, 1] = 4.0 * width * c**2 * (1.0 + 3.0 * t**2) - 4.0 * poisson * k * c
    bend[:, 2, 2] = second * bent
    bend[:, 0, 1] = bend[:, 1, 0] = 8.0 * width * c * wide * t - 4.0 * poisson * k * t
    bend[:, 0, 2] = bend[:, 2, 0] = 2.0 * first * c * wide**2
    bend[:, 1, 2] = bend[:, 2, 1] = 4.0 * first * c**2 * wide * t
    return value, slope, bend
