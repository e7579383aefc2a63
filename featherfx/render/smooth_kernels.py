"""Shadow and sky that few rays have found, smoothed over neighbouring pixels that agree.

Of each pixel the share V of the sun and O of the sky is known as a mean of n samples with a
variance, apart from the light that they are shares of, which keeps all that is fine. It becomes
the mean over pixels q near p, weighted by

    exp(-((V_p - V_q)^2 / (var_p + var_q) + the same of O) / 2)

where V, O and variances of the weights are means over 3 x 3 pixels (the test of Rousselle et al.
2012, with the weights of the bilateral filter). Where shadows differ by more than chance would
have it they stay as they are.

A pixel is 13 numbers: light of the sun and of the sky, were all of it there (3 each), V, O (3), the
variances of V and O, and the share of the pixel that is covered.
"""

from __future__ import annotations

from math import exp

from featherfx.jit.compiled import kernel
from featherfx.render.light_kernels import displayed

MEAN_NUMBERS = 13
SMOOTHING_REACH = 4  # pixels
_LEAST = 0.04  # variance of a sample, at least: some may all have found the same by chance
_V, _O, _VAR, _COVERED = 6, 7, 10, 12


@kernel
def _brightness(colour):
    return 0.3 * colour[0] + 0.5 * colour[1] + 0.2 * colour[2]


@kernel
def gather_light(which, samples, found, pixels):
    """Fill pixels (P, MEAN_NUMBERS) with the samples `which` of theirs.

    found: of each sample, light of the sun, of the sky, share of the one (N,), and of the other (N,
    3).
    """
    lit, open_sky, sunlight, seen = found
    for index in range(len(which)):
        pixel, weights = pixels[which[index] // samples], (lit[index], open_sky[index])
        sun, sky = _brightness(weights[0]) + 1e-6, _brightness(weights[1]) + 1e-6
        share = sky * _brightness(seen[index])
        for k in range(3):
            pixel[k] += weights[0][k]
            pixel[3 + k] += weights[1][k]
            pixel[_O + k] += (weights[1][k] + 1e-6) * seen[index, k]
        pixel[_V] += sun * sunlight[index]
        pixel[_VAR] += sun * sunlight[index] ** 2
        pixel[_VAR + 1] += share * share / sky
        pixel[_COVERED] += 1.0
    for index in range(len(pixels)):
        pixel = pixels[index]
        count = pixel[_COVERED]
        if count == 0.0:
            continue
        sun, sky = _brightness(pixel[:3]) + 1e-6 * count, _brightness(pixel[3:6]) + 1e-6 * count
        pixel[_V] /= sun
        for k in range(3):
            pixel[_O + k] /= pixel[3 + k] + 1e-6 * count
            pixel[k] /= count
            pixel[3 + k] /= count
        spread = pixel[_VAR] / sun - pixel[_V] ** 2
        pixel[_VAR] = max(spread, _LEAST) / count
        spread = pixel[_VAR + 1] / sky - _brightness(pixel[_O : _O + 3]) ** 2
        pixel[_VAR + 1] = max(spread, _LEAST) / count
        pixel[_COVERED] = count / samples


@kernel
def _means(pixels, row, column, means):
    """Fill `means` (4,) with V, O and their variances over the pixels around one."""
    total = 0.0
    means[:] = 0.0
    for y in range(max(row - 1, 0), min(row + 2, pixels.shape[0])):
        for x in range(max(column - 1, 0), min(column + 2, pixels.shape[1])):
            pixel = pixels[y, x]
            weight = pixel[_COVERED]
            total += weight
            means[0] += weight * pixel[_V]
            means[1] += weight * _brightness(pixel[_O : _O + 3])
            means[2] += weight * weight * pixel[_VAR]
            means[3] += weight * weight * pixel[_VAR + 1]
    if total > 0.0:
        means[0], means[1] = means[0] / total, means[1] / total
        means[2], means[3] = means[2] / (total * total), means[3] / (total * total)


@kernel
def _smoothed(pixels, means, row, column, top, light):
    """Fill `light` (3,) with that of a pixel. means: of the rows from `top` on."""
    own, total = means[row - top, column], 0.0
    sun, sky_r, sky_g, sky_b = 0.0, 0.0, 0.0, 0.0
    for y in range(max(row - SMOOTHING_REACH, 0), min(row + SMOOTHING_REACH + 1, pixels.shape[0])):
        for x in range(
            max(column - SMOOTHING_REACH, 0), min(column + SMOOTHING_REACH + 1, pixels.shape[1])
        ):
            pixel, other = pixels[y, x], means[y - top, x]
            if pixel[_COVERED] == 0.0:
                continue
            apart = (own[0] - other[0]) ** 2 / (own[2] + other[2])
            apart += (own[1] - other[1]) ** 2 / (own[3] + other[3])
            if apart > 16.0:
                continue
            weight = pixel[_COVERED] * exp(-0.5 * apart)
            total += weight
            sun += weight * pixel[_V]
            sky_r += weight * pixel[_O]
            sky_g += weight * pixel[_O + 1]
            sky_b += weight * pixel[_O + 2]
    own_light = pixels[row, column]
    light[0] = (sun * own_light[0] + sky_r * own_light[3]) / total
    light[1] = (sun * own_light[1] + sky_g * own_light[4]) / total
    light[2] = (sun * own_light[2] + sky_b * own_light[5]) / total


@kernel
def finish(pixels, top, behind, means, shown):
    """Fill `shown` (R, columns, 3) of displays, 0 to 1, with the rows of pixels (rows, columns,
    MEAN_NUMBERS) from `top` on.

    behind: (R, columns, 3) what is seen where nothing is. means: room for
    (R + 2 SMOOTHING_REACH, columns, 4).
    """
    first = max(top - SMOOTHING_REACH, 0)
    last = min(top + len(shown) + SMOOTHING_REACH, pixels.shape[0])
    for row in range(first, last):
        for column in range(pixels.shape[1]):
            _means(pixels, row, column, means[row - first, column])
    for row in range(len(shown)):
        for column in range(pixels.shape[1]):
            covered, light = pixels[top + row, column, _COVERED], shown[row, column]
            light[:] = 0.0
            if covered > 0.0:
                _smoothed(pixels, means, top + row, column, first, light)
            for k in range(3):
                back = (1.0 - covered) * behind[row, column, k]
                light[k] = covered * displayed(light[k]) + back
