"""Landmarks of a bird's body: which way it looks, and what is wrong with them."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, parallel
from featherfx.groom.keys.problems import Place
from featherfx.groom.skin.skin import closest

Points = dict[str, Array]

# ways from beak to tail, that a landmark may be away from the nearer of them
_FARTHEST = 1.5
# of that way, that a landmark may be off the skin: joints lie within it; by eye
_OFF = 0.25
# median distances from the median landmark, that one may be away from it: another unit is farther
_STRAY = 50.0
# axes (forward, left, up) along which a landmark has to be ahead of another
_AHEAD = (
    (1, "left_shoulder", "right_shoulder"),
    (1, "left_heel", "right_heel"),
    (1, "left_eye", "right_eye"),
    (0, "breast", "vent"),
    (0, "beak", "nape"),
    (0, "crown", "nape"),
    (0, "vent", "tail"),
    (2, "nape", "breast"),
)
# of both sides or of none
_PAIRED = "wing", "heel", "eye"


def distance(points: Points, first: str, second: str) -> float:
    """m, between two landmarks."""
    return float(np.linalg.norm(points[first] - points[second]))


def axes_of(points: Points, up: tuple[float, ...], place: Place) -> Array:
    """(3, 3) forward along the trunk, left and up. Raises InputError."""
    _check_pairs(points, place)
    flat = _single(points)
    _refuse_strays(flat, place)
    size = max(distance(points, "beak", "tail"), 1e-9)
    for k, (name, point) in enumerate(flat):
        for other, there in flat[:k]:
            if np.linalg.norm(point - there) < 1e-3 * size:
                place.child(name).refuse(f"is at the place of {other}")
    shoulders = 0.5 * (points["right_shoulder"] + points["left_shoulder"])
    forward = shoulders - points["tail"]
    if parallel(forward, up):
        place.child("tail").refuse("is right below or above the shoulders. Set `up`")
    axes = frames_from(forward, up)
    for name, point in flat:
        away = min(float(np.linalg.norm(point - points[end])) for end in ("beak", "tail"))
        if away > _FARTHEST * size:
            told = f"is {away:.3g} m from beak and tail, which are {size:.3g} m apart"
            place.child(name).refuse(f"{told}. Move it within {_FARTHEST:g} times that")
    _check_order(points, axes, place)
    return axes


def _refuse_strays(flat: list[tuple[str, Array]], place: Place) -> None:
    """Raise InputError for a landmark in another unit than the others."""
    every = np.array([point for _, point in flat])
    away = np.linalg.norm(every - np.median(every, axis=0), axis=1)
    near = float(np.median(away))
    if away.max() > _STRAY * near:
        told = f"is {away.max():.3g} m from the middle of the landmarks, most within {near:.3g} m"
        place.child(flat[int(away.argmax())][0]).refuse(f"{told}. Give all in one unit")


def _single(points: Points) -> list[tuple[str, Array]]:
    """Landmarks that are one point."""
    return [(name, point) for name, point in points.items() if point.ndim == 1]


def _check_pairs(points: Points, place: Place) -> None:
    for part in _PAIRED:
        sides = f"right_{part}", f"left_{part}"
        given = [name for name in sides if name in points]
        if len(given) == 1:
            missing = sides[1] if given[0] == sides[0] else sides[0]
            told = f"{given[0]} is there" if part != "wing" else f"{given[0]} has its landmarks"
            place.child(missing).refuse(f"missing, {told}")


def _check_order(points: Points, axes: Array, place: Place) -> None:
    """That landmarks are ahead of each other as they are on a bird, but for what is beside it: a
    neck that is stretched out is as low as the breast. Raises InputError."""
    gaps = {
        each: (points[each[1]] - points[each[2]]) @ axes
        for each in _AHEAD
        if {*each[1:]} <= points.keys()
    }
    wrong = [each for each, gap in gaps.items() if -gap[each[0]] >= (each[0] == 2) * abs(gap[0])]
    if {"left_shoulder", "breast"} <= {name for _, name, _ in wrong}:
        # forward is from the tail to the shoulders
        place.child("beak").refuse("is behind tail: are the two exchanged?")
    for axis, name, back in wrong:
        side = ("behind", "to the right of", "below")[axis]
        place.child(name).refuse(f"is {side} {back}: are the two exchanged?")


def check_on_skin(points: Points, corners: Array, place: Place) -> None:
    """That landmarks are near a skin of triangles (T, 3, 3) m. Raises InputError."""
    flat, most = _single(points), _OFF * distance(points, "beak", "tail")
    places = np.array([point for _, point in flat])
    triangle, weights = closest(places, corners)
    away = np.linalg.norm(np.einsum("nk,nkc->nc", weights, corners[triangle]) - places, axis=1)
    worst = int(np.argmax(away))
    if away[worst] > most:
        size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
        told = (
            f"is {away[worst]:.3g} m off the skin, whose box has a diagonal of {size:.3g} m. Give"
        )
        told += f" it in the same unit, within {most:.3g} m, a quarter of the way from beak to tail"
        place.child(flat[worst][0]).refuse(told)
