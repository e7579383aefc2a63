"""Light on thin feathers: what rays carry back to the camera, one sample at a time.

    L = V S [ a d(n.l) + k g(t, h) + a k' g'(t', h) ] + O (a + c) E,    g = sin(t, h)^p

a colour, S the sun's light and V the share of it that arrives through the vanes before it, d what
is sent back, a share of it through the vane, n normal towards the camera, l direction of the sun.
Gloss is that of fibres in two lobes (Kajiya & Kay 1989, with the tangents of Marschner et al.
2003): a narrow one as white as the light, of t bent towards the fibre's root, and a broad one,
mostly of the feather's colour, bent to its end; h is halfway between light and camera. c is the
sheen where a surface is seen at a low angle. Films add their colours to both. Barbs have round
cross-sections where each is wider than pixels: their normal is turned outwards by the place across
them, and furrows are darker.

E is the light of an open sky by its first three zonal harmonics (Ramamoorthi & Hanrahan 2001,
equation 10) and of a soft lamp from behind, O what one ray a sample finds of it: nothing that
stands free is grainy. V and O are smoothed over neighbouring pixels (tracer.py).

All arrays are of N samples; vectors are (N, 3) in single precision.
"""

from __future__ import annotations

from math import cos, exp, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import (
    accumulate,
    combined,
    cross,
    dot,
    length,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel
from featherfx.render.barb_kernels import barb_there, chance, half_width, is_gap, mixed_bits, streak

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

# what a triangle is of; rows of _MATERIALS. A floor only takes shadow: its colour is that behind it
VANE, RACHIS_MATERIAL, SKIN_MATERIAL, FLOOR, EYE = 0, 1, 2, 3, 4
# all by eye
EXPOSURE = 0.40
_FINE = 4.0  # pixels: what stands nearer before a vane than these casts no shadow on it
_FURROW = 0.8  # darkness of furrows between barbs of full roundness
_THIN = 0.25  # more light goes through the free ends of barbs
_FILM_SUN, _FILM_SKY = 0.13, 0.14  # shares of light that films send back where colours agree
_INDEX, _WAVES = 1.56, (6.1e2, 5.4e2, 4.5e2)  # of keratin; nm, of red, green and blue
_LEAN = 0.24  # of barbs, tangent, at most
_BENT, _WIDER = 0.12, 0.2  # tangents of the lobes of gloss: to the root, to the end of the fibre
# share of light that goes through, light that a shadow lets through, sheen, and of both lobes of
# gloss k and p
_MATERIALS = np.array(
    [
        [0.34, 0.30, 0.35, 0.10, 24.0, 0.24, 5.0],
        [0.0, 0.0, 0.10, 0.20, 40.0, 0.10, 8.0],
        [0.0, 0.0, 0.10, 0.05, 20.0, 0.0, 1.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0],
        [0.0, 0.0, 0.30, 3.0, 600.0, 0.15, 20.0],
    ]
)


class Lens(NamedTuple):
    """A camera. eye, right, up, back: (3,) as of View. width, height, shift_x, shift_y: of the
    picture over the depth, or in scene units if orthographic. radius: of the lens, scene units, 0
    for a pinhole. focus: depth that is sharp. columns, rows: pixels of the picture."""

    eye: Array
    right: Array
    up: Array
    back: Array
    width: float
    height: float
    shift_x: float
    shift_y: float
    orthographic: bool
    radius: float
    focus: float
    columns: int
    rows: int


class Tile(NamedTuple):
    """Whole rows of pixels. top: the first. samples: rays a pixel, a power of 2. offset: m, by
    which rays start off surfaces. origins, rays: (N, 3) of all samples, pixel by pixel."""

    lens: Lens
    top: int
    samples: int
    offset: float
    origins: Floats
    rays: Floats


class HitSurface(NamedTuple):
    """Surface that rays hit. triangles: (T, 3). material: (T,). normals, tangents, colours: (V, 3),
    of vertices; colours are linear. barbs: (V, 5) as of Geometry."""

    triangles: Integers
    material: NDArray[np.uint8]
    normals: Floats
    tangents: Floats
    colours: Floats
    barbs: Floats


class Lights(NamedTuple):
    """sun: (3,) unit, towards it. sun_light: (3,). sun_radius: tangent of half its angle. rim,
    rim_light: as of the sun, of the lamp behind. up: (3,) unit. zenith, horizon, ground: (3,) light
    of the sky there. harmonics: (3, 3) of the light that a surface receives, by order and
    colour."""

    sun: Array
    sun_light: Array
    sun_radius: float
    rim: Array
    rim_light: Array
    up: Array
    zenith: Array
    horizon: Array
    ground: Array
    harmonics: Array


class RayHits(NamedTuple):
    """Hits of N rays. places: (N, 3) a little off the surface, on the sun's side. beyond: (N, 3)
    on the sky ray's side. normals, tangents, colours: (N, 3). to_sun, to_sky: (N, 3) rays on from
    there. material: (N,). through: (N,) share of light that goes through. film: (N,) nm."""

    places: Floats
    beyond: Floats
    normals: Floats
    tangents: Floats
    colours: Floats
    to_sun: Floats
    to_sky: Floats
    material: NDArray[np.uint8]
    through: Floats
    film: Floats


@kernel
def _pair(x, y, sample, samples, use):
    """Two numbers in 0..1 for a sample of the pixel (x, y): points of the R2 sequence (Roberts
    2018), shifted at random and in another order for each pixel and use. samples: a power of 2."""
    seed = mixed_bits(8 * (x + 8192 * y) + use)
    order = sample ^ (seed & (samples - 1))
    first = order * 0.7548776662466927 + (seed >> 8) * 5.9604644775390625e-08
    second = order * 0.5698402910980532 + mixed_bits(seed) * 2.3283064365386963e-10
    return first - int(first), second - int(second)


@kernel
def _tent(value):
    """A number in 0..1 as one in -1..1 whose density is a tent."""
    return sqrt(2.0 * value) - 1.0 if value < 0.5 else 1.0 - sqrt(2.0 * (1.0 - value))


@kernel
def camera_rays(tile):
    """Fill origins and rays of a tile, pixel by pixel."""
    lens, samples, rays = tile.lens, tile.samples, tile.rays
    for index in range(len(rays)):
        pixel, sample = index // samples, index % samples
        column, row = pixel % lens.columns, tile.top + pixel // lens.columns
        first, second = _pair(column, row, sample, samples, 0)
        x = (column + 0.5 + _tent(first)) / lens.columns - 0.5
        y = 0.5 - (row + 0.5 + _tent(second)) / lens.rows
        x, y = x * lens.width + lens.shift_x, y * lens.height + lens.shift_y
        aside = combined(x, lens.right, y, lens.up)
        if lens.orthographic:
            store(tile.origins[index], combined(1.0, lens.eye, 1.0, aside))
            store(rays[index], scale(-1.0, lens.back))
            continue
        ray = sub(aside, lens.back)
        origin = combined(1.0, lens.eye, 0.0, ray)
        if lens.radius > 0.0:
            first, second = _pair(column, row, sample, samples, 1)
            angle, reach = 2.0 * pi * first, lens.radius * sqrt(second)
            offset = combined(reach * cos(angle), lens.right, reach * sin(angle), lens.up)
            origin = combined(1.0, origin, 1.0, offset)
            ray = combined(1.0, ray, -1.0 / lens.focus, offset)
        store(tile.origins[index], origin)
        store(rays[index], scale(1.0 / length(ray), ray))


@kernel
def _interpolated(values, corners, u, v):
    a, b = combined(1.0 - u - v, values[corners[0]], u, values[corners[1]]), values[corners[2]]
    return combined(1.0, a, v, b)


@kernel
def _unit(vector, fallback):
    size = length(vector)
    return scale(1.0 / size, vector) if size > 1e-12 else fallback


@kernel
def _frame(axis):
    """Two unit vectors at right angles to a unit vector and to each other."""
    other = (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0)
    first = cross(axis, other)
    first = scale(1.0 / length(first), first)
    return first, cross(axis, first)


@kernel
def _around(axis, radius, height, angle):
    """height along a unit axis, and radius aside, turned by an angle about it."""
    first, second = _frame(axis)
    aside = combined(radius * cos(angle), first, radius * sin(angle), second)
    return combined(height, axis, 1.0, aside)


@kernel
def surface_points(surface, lights, tile, hits, which, points):
    """Fill `points` where samples `which` hit.

    hits: (primID, u, v, tfar, Ng) of all samples of the tile.
    """
    prims, us, vs, far, geometric = hits
    lens, samples, offset, rays = tile.lens, tile.samples, tile.offset, tile.rays
    for index in range(len(which)):
        at = which[index]
        pixel, sample = at // samples, at % samples
        column, row = pixel % lens.columns, tile.top + pixel // lens.columns
        prim, u, v, ray = prims[at], us[at], vs[at], rays[at]
        corners, material = surface.triangles[prim], surface.material[prim]
        face = _unit(geometric[at], (0.0, 0.0, 1.0))
        face = scale(-1.0, face) if dot(face, ray) > 0.0 else face
        tangent = _unit(_interpolated(surface.tangents, corners, u, v), (0.0, 0.0, 0.0))
        smooth = _unit(_interpolated(surface.normals, corners, u, v), face)
        through, rounded, lean = _MATERIALS[material, 0], 0.0, 0.0
        if material == VANE:
            number, barb, strong, free = barb_there(surface.barbs, corners, u, v)
            half, off = half_width(number, barb, free), number - int(number) - 0.5
            rounded = strong * off / half if abs(off) < half else 0.0
            rounded += 0.8 * min(free, 1.0) * (chance(int(number) + 104729) - 0.5)
            lean = _LEAN * streak(number, barb)
            through += _THIN * (1.0 - 2.0 * max(half, 0.0))
        furrow = 1.0 - _FURROW * rounded * rounded
        side = _unit(cross(tangent, smooth), (0.0, 0.0, 0.0))
        smooth = scale(-1.0, smooth) if dot(smooth, face) < 0.0 else smooth
        normal = _unit(combined(1.0, smooth, rounded + lean, side), face)
        first, second = _pair(column, row, sample, samples, 2)
        sun = _around(lights.sun, lights.sun_radius * sqrt(first), 1.0, 2.0 * pi * second)
        sun = scale(1.0 / length(sun), sun)
        first, second = _pair(column, row, sample, samples, 3)
        axis, fraction = normal, first / (1.0 - through)
        if first >= 1.0 - through:
            axis, fraction = scale(-1.0, normal), (first - 1.0 + through) / through
        sky = _around(axis, sqrt(fraction), sqrt(max(1.0 - fraction, 0.0)), 2.0 * pi * second)
        place = combined(1.0, tile.origins[at], far[at], ray)
        fine = offset if material != VANE else _FINE * _pixel_there(lens, far[at])
        store(points.places[index], combined(1.0, _off(place, face, sun, offset), fine, sun))
        store(points.beyond[index], combined(1.0, _off(place, face, sky, offset), fine, sky))
        store(points.normals[index], normal)
        store(points.tangents[index], tangent)
        colour = _interpolated(surface.colours, corners, u, v)
        store(points.colours[index], scale(furrow, colour))
        store(points.to_sun[index], sun)
        store(points.to_sky[index], sky)
        points.material[index], points.through[index] = material, through
        points.film[index] = surface.barbs[corners[0], 4] if material == VANE else 0.0


@kernel
def _pixel_there(lens, far):
    """m, of a pixel's height at a distance along a ray."""
    return lens.height / lens.rows * (1.0 if lens.orthographic else far)


@kernel
def _off(place, face, direction, offset):
    """A place moved off its surface to the side that a direction leads to."""
    return combined(1.0, place, offset if dot(face, direction) > 0.0 else -offset, face)


@kernel
def _passes(surface, prim, u, v):
    """Check that a ray that has hit something goes on between barbs."""
    if prim < 0 or surface.material[prim] != VANE:
        return False
    number, place, _, free = barb_there(surface.barbs, surface.triangles[prim], u, v)
    return is_gap(number, place, free)


@kernel
def find_gaps(surface, hits, which, gaps):
    """Fill `gaps` (N,) with whether rays `which` go on between barbs. hits: as of
    surface_points."""
    prims, us, vs = hits[:3]
    for index in range(len(which)):
        at = which[index]
        gaps[index] = _passes(surface, prims[at], us[at], vs[at])


@kernel
def pass_vanes(surface, hits, which, offset, places, rays, light):
    """Weaken `light` (N,) of the rays `which` by what each has hit and go on behind it."""
    prims, us, vs, far = hits
    for index in range(len(which)):
        at, prim = which[index], prims[index]
        if prim < 0:
            continue
        if not _passes(surface, prim, us[index], vs[index]):
            light[at] *= _MATERIALS[surface.material[prim], 1]
        store(places[at], combined(1.0, places[at], far[index] + offset, rays[at]))


@kernel
def _sky(lights, direction):
    """(3,) light that comes from a direction of the sky, or from the ground."""
    height = dot(direction, lights.up)
    if height >= 0.0:
        fraction = sqrt(height)
        return combined(1.0 - fraction, lights.horizon, fraction, lights.zenith)
    fraction = 1.0 - exp(5.0 * height)
    return combined(1.0 - fraction, lights.horizon, fraction, lights.ground)


@kernel
def _received(lights, height):
    """(3,) light of the open sky on a surface whose normal is that high."""
    bent = 1.5 * height * height - 0.5
    flat = combined(1.0, lights.harmonics[0], height, lights.harmonics[1])
    return combined(1.0, flat, bent, lights.harmonics[2])


@kernel
def displayed(light):
    """Light as displays show it, 0 to 1: bright and dark parts compressed (Narkowicz 2015, a fit of
    the ACES curve), then sRGB."""
    light = EXPOSURE * max(light, 0.0)
    light = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    light = min(light, 1.0)
    return 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1.0 / 2.4) - 0.055


@kernel
def _lobe(tangent, bent, normal, halfway, power):
    """Gloss of a fibre whose tangent is bent towards the normal."""
    along = dot(_unit(combined(1.0, tangent, bent, normal), normal), halfway)
    return max(1.0 - along * along, 0.0) ** (0.5 * power)


@kernel
def _shining(points, index, sun, ray):
    """Both lobes of gloss."""
    row = _MATERIALS[points.material[index]]
    normal, tangent = scale(1.0, points.normals[index]), scale(1.0, points.tangents[index])
    halfway = _unit(sub(sun, ray), normal)
    if points.material[index] in (SKIN_MATERIAL, EYE):
        facing = max(dot(normal, halfway), 0.0)
        return row[3] * facing ** row[4], row[5] * facing ** row[6]
    narrow = row[3] * _lobe(tangent, -_BENT, normal, halfway, row[4])
    return narrow, row[5] * _lobe(tangent, _WIDER, normal, halfway, row[6])


@kernel
def of_film(film, cosine):
    """(3,) shares 0..1 by which a film of keratin on melanin agrees with red, green and blue that
    come at an angle: both of its faces turn the phase, so 2 n d cos(b) of a whole wave is full."""
    path = 2.0 * _INDEX * film * sqrt(1.0 - (1.0 - cosine * cosine) / (_INDEX * _INDEX))
    red, green, blue = _WAVES
    return (
        0.5 + 0.5 * cos(2.0 * pi * path / red),
        0.5 + 0.5 * cos(2.0 * pi * path / green),
        0.5 + 0.5 * cos(2.0 * pi * path / blue),
    )


@kernel
def _add_film(lights, points, index, sun, ray, light):
    """Add to light of the sun and of the sky, (2 times (N, 3)), what a film sends back."""
    film, normal = points.film[index], scale(1.0, points.normals[index])
    halfway = _unit(sub(sun, ray), normal)
    gloss = _lobe(scale(1.0, points.tangents[index]), 0.0, normal, halfway, 4.0)
    gloss *= min(max(4.0 * dot(normal, sun), 0.0), 1.0)
    near = of_film(film, min(abs(dot(halfway, sun)), 1.0))
    far = of_film(film, min(abs(dot(normal, ray)), 1.0))
    sky = _received(lights, dot(normal, lights.up))
    for k in range(3):
        light[0][index, k] += _FILM_SUN * gloss * near[k] * lights.sun_light[k]
        light[1][index, k] += _FILM_SKY * far[k] * sky[k]


@kernel
def shade(surface, lights, points, rays, which, sky_prims, light):
    """Fill `light` (3 times (N, 3)) that goes back to the camera: of the sun were nothing before
    it, of the sky so, and how much of this is there.

    sky_prims: hit by the rays to the sky, -1 for none; what is hit there is taken to be lit by half
    of the sky's mean.
    """
    lit, open_sky, seen = light
    for index in range(len(which)):
        material, through = points.material[index], points.through[index]
        ray, sun = scale(1.0, rays[which[index]]), scale(1.0, lights.sun)
        normal, colour = scale(1.0, points.normals[index]), points.colours[index]
        toward, height = dot(normal, sun), dot(normal, lights.up)
        back = (1.0 - through) * toward if toward > 0.0 else -through * toward
        sky = combined(
            1.0 - through, _received(lights, height), through, _received(lights, -height)
        )
        if material == FLOOR:
            # its colour is that behind it, so that all of its light is of one unit
            for k in range(3):
                whole = toward * lights.sun_light[k] + sky[k]
                lit[index, k] = toward * lights.sun_light[k] / whole
                open_sky[index, k] = sky[k] / whole
                seen[index, k] = 0.0 if sky_prims[index] >= 0 else 1.0
            continue
        behind = max(dot(normal, lights.rim), 0.0)
        rest, prim = sky, sky_prims[index]
        if prim >= 0:
            met = surface.colours[surface.triangles[prim, 0]]
            hidden, mean = _sky(lights, points.to_sky[index]), lights.harmonics[0]
            met = (0.5 * met[0] * mean[0], 0.5 * met[1] * mean[1], 0.5 * met[2] * mean[2])
            rest = combined(1.0, sky, 1.0, sub(met, hidden))
        narrow, broad = _shining(points, index, sun, ray)
        shown = min(max(4.0 * toward, 0.0), 1.0)
        sheen = _MATERIALS[material, 2] * (1.0 - min(abs(dot(normal, ray)), 1.0)) ** 4
        for k in range(3):
            lit[index, k] = lights.sun_light[k] * (
                colour[k] * back + shown * (narrow + broad * (0.15 + 0.85 * colour[k]))
            )
            rim = behind * lights.rim_light[k]
            whole = max(sky[k] + rim, 1e-6)
            open_sky[index, k] = (colour[k] + sheen * (0.3 + 0.7 * colour[k])) * whole
            seen[index, k] = max(rest[k] + (rim if prim < 0 else 0.0), 0.0) / whole
        if points.film[index] > 0.0:
            _add_film(lights, points, index, sun, ray, (lit, open_sky))


@kernel
def shade_values(points, rays, which, shown):
    """Colours (N, 3) as they are, a little darker where the surface turns away."""
    for index in range(len(which)):
        facing = abs(dot(points.normals[index], rays[which[index]]))
        store(shown[index], scale(0.72 + 0.28 * facing, points.colours[index]))


@kernel
def gather(which, samples, shown, sums, covered):
    """Add colours (N, 3) of samples `which` to their pixels: sums (P, 3), covered (P,)."""
    for index in range(len(which)):
        pixel = which[index] // samples
        accumulate(sums[pixel], 1.0, shown[index])
        covered[pixel] += 1.0
