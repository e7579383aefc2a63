"""Barbs that rays find within a vane, colours between its points, and shadows that are smoothed."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.render.barb_kernels import colour_vanes, half_width, is_gap
from featherfx.render.light_kernels import displayed, of_film
from featherfx.render.tracer import MEAN_NUMBERS, SMOOTHING_REACH, finish, gather_light, light_of


def open_share(place, free):
    """Of places all along a vane of 500 barbs, one place on the barb."""
    numbers = np.arange(0.005, 500.0, 0.01)
    return np.mean([is_gap(number, place, free) for number in numbers])


def test_a_vane_is_closed_within_and_opens_towards_its_edge():
    assert open_share(0.0, 0.1) == 0.0
    assert open_share(0.3, 0.1) < 0.005
    shares = [open_share(place, 0.1) for place in (0.88, 0.92, 0.96, 0.995)]
    assert (np.diff(shares) > 0.1).all()
    assert 0.05 < shares[0] < 0.2
    assert shares[-1] > 0.8


def test_barbs_that_do_not_hook_are_apart_along_all_of_their_length():
    shares = [open_share(place, 1.3) for place in (0.2, 0.5, 0.8)]
    assert (np.diff(shares) > 0.1).all()
    assert shares[0] > 0.1


def test_barbs_end_one_by_one_and_stay_where_they_are():
    ends = {}
    for barb in range(1, 51):
        ends[barb] = next(
            s for s in np.linspace(0.9, 1.0, 201) if half_width(barb + 0.5, s, 0.1) < 0
        )
    assert len(set(ends.values())) > 20
    assert 0.93 < min(ends.values()) < 0.96
    # all over its width
    assert half_width(7.1, 0.95, 0.1) == half_width(7.9, 0.95, 0.1)


def test_bars_of_a_coarse_vane_have_straight_borders():
    """Barbs at 45 degrees, 9 rows and 4 columns: a bar's border is off by no more than a row."""
    heights, places = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 0.6, 4)
    ahead = (heights[:, None] + places)[None]
    border, step = 0.7, heights[1]
    dark = np.repeat((ahead > border)[..., None], 3, axis=3).astype(float)
    barbs, columns = np.linspace(0.0, 1.0, 60), np.linspace(0.0, 3.0, 40)
    distances = (barbs[:, None] + 0.2 * columns)[None]
    shades = np.zeros((*distances.shape, 3))
    colour_vanes(ahead, dark, distances, columns, shades)
    far = np.abs(distances - border) > step
    assert (~far).any()
    np.testing.assert_array_equal(shades[far][:, 0], (distances > border)[far])
    # at the same share of the way between rows on every column it would not be
    on_columns = np.stack([np.interp(barbs, heights, dark[0, :, k, 0]) for k in range(4)], axis=1)
    sheared = np.stack([np.interp(columns, np.arange(4), each) for each in on_columns])
    assert np.abs(sheared - (distances[0] > border))[far[0]].max() > 0.3


def pixels_of(share, samples, seed=1):
    """Pixels (rows, columns, MEAN_NUMBERS) of a white surface, sunlit by share (rows, columns)."""
    random = np.random.default_rng(seed)
    sunlight = (random.uniform(size=(share.size, samples)) < share.reshape(-1, 1)).ravel()
    count = share.size * samples
    pixels = np.zeros((share.size, MEAN_NUMBERS), np.float32)
    lit, seen = np.full((count, 3), 0.5), np.ones((count, 3))
    found = lit, np.full((count, 3), 0.1), sunlight.astype(float), seen
    gather_light(np.arange(count), samples, found, pixels)
    return pixels.reshape(*share.shape, MEAN_NUMBERS)


def finished(pixels):
    """Light (rows, columns), of pictures of 16 rows at a time."""
    rows, columns = pixels.shape[:2]
    strips = []
    for top in range(0, rows, 16):
        shown = np.zeros((min(16, rows - top), columns, 3))
        means = np.zeros((len(shown) + 2 * SMOOTHING_REACH, columns, 4))
        finish(pixels, top, np.ones_like(shown), means, shown)
        strips.append(shown)
    return light_of(np.concatenate(strips))[..., 0]


def test_grain_of_even_shadow_goes_and_its_border_stays():
    share = np.full((40, 40), 0.3)
    share[:, 20:] = 0.9
    exact = 0.5 * share + 0.1
    pixels = pixels_of(share, 16)
    before = np.abs(0.5 * pixels[..., 6] + 0.1 - exact)
    after = np.abs(finished(pixels) - exact)
    inside = np.ones(40, dtype=bool)
    inside[17:23] = False
    assert after[:, inside].mean() < 0.35 * before[:, inside].mean()
    across = finished(pixels).mean(axis=0)
    assert across[17] - exact[0, 0] < 0.06
    assert exact[0, -1] - across[22] < 0.06


def test_what_is_finer_than_shadow_is_kept_and_empty_pixels_show_what_is_behind():
    pixels = pixels_of(np.ones((20, 20)), 4)
    pixels[::2, :, :3] *= 0.5
    pixels[:5] = 0.0
    light = finished(pixels)
    np.testing.assert_allclose(light[6::2], 0.35, rtol=1e-4)
    np.testing.assert_allclose(light[7::2], 0.6, rtol=1e-4)
    np.testing.assert_allclose(light[:5], light_of(np.ones(3))[0])


def test_light_of_a_display_is_that_which_it_shows():
    shown = np.linspace(0.01, 0.95, 20)
    assert [displayed(each) for each in light_of(shown)] == pytest.approx(shown, abs=1e-9)


def test_a_pigeons_films_turn_from_green_to_purple_and_from_purple_to_green():
    """As those of barbules do when they are seen from aside (Yin et al. 2006)."""
    green, purple = 510.0, 425.0
    for film, other in ((green, False), (purple, True)):
        for cosine, turned in ((1.0, False), (0.45, True)):
            red, middle, blue = of_film(film, cosine)
            is_green = middle > max(red, blue)
            assert is_green == (turned == other), (film, cosine)
            assert is_green or middle < min(red, blue)
