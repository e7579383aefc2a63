"""Crossings of triangles: known ones, an oracle in exact arithmetic, what the command prints."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.feather.crossings import BODY, find_intersections, make_patches, triangles_cross
from featherfx.usd.check.measures import count_crossings

FLAT = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    """About the x axis through y = 0.5, z = 0, in degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    middle = np.array([0.0, 0.5, 0.0])
    return (points - middle) @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + middle


def moved(points: np.ndarray, *way: float) -> np.ndarray:
    return points + np.array(way)


def crossings(*meshes, owners=None, jobs=1):
    """Of meshes (points, triangles)."""
    owners = range(len(meshes)) if owners is None else owners
    parts = [
        (points, triangles, np.zeros(len(triangles), bool), owner)
        for (points, triangles), owner in zip(meshes, owners, strict=True)
    ]
    return find_intersections(
        np.concatenate([points for points, _ in meshes]), make_patches(parts), jobs
    )


def test_two_quads_that_cross():
    found = crossings((FLAT, QUAD), (moved(turned(FLAT, 90.0), 0.1, 0, 0), QUAD))
    # by hand: the diagonals meet the line of crossing in the middle, so each half crosses both
    assert found.total == 3
    assert found.owners.tolist() == [[0, 1]]


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (moved(FLAT, 0.3, 0.3, 0.0), "in one plane, over each other"),
        (moved(FLAT, 0.0, 0.0, 1e-9), "a nanometre above"),
        (moved(FLAT, 1.0, 0.0, 0.0), "beside, with an edge in common"),
        (turned(FLAT, 40.0) - turned(FLAT, 40.0)[0], "hinged along an edge"),
        (moved(FLAT, 1.0, 1.0, 0.0), "with a corner in common"),
        (moved(turned(FLAT, 90.0), 0, 0, 0.5), "standing on it"),
    ],
)
def test_what_only_touches_does_not_cross(other, what):
    assert crossings((FLAT, QUAD), (other, QUAD)).total == 0, what


def exact_side(a, b, c, d):
    a, b, c, d = ([Fraction(float(x)) for x in point] for point in (a, b, c, d))
    u, v, w = ([p - q for p, q in zip(point, a, strict=True)] for point in (b, c, d))
    normal = [u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2] for k in range(3)]
    value = sum(p * q for p, q in zip(normal, w, strict=True))
    return (value > 0) - (value < 0)


def exactly_cross(p, q):
    """The definition of the kernels, in fractions."""
    for first, second in ((p, q), (q, p)):
        sides = {exact_side(*second, corner) for corner in first}
        if not {-1, 1} <= sides:
            return False
    for first, second in ((p, q), (q, p)):
        for k in range(3):
            start, end = first[k], first[(k + 1) % 3]
            if exact_side(*second, start) * exact_side(*second, end) >= 0:
                continue
            sides = [exact_side(start, end, second[j], second[(j + 1) % 3]) for j in range(3)]
            if min(sides) >= 0 or max(sides) <= 0:
                return True
    return False


def as_tuples(triangle):
    return tuple(tuple(float(x) for x in point) for point in triangle)


@pytest.mark.parametrize("kind", ["lattice", "floats", "nearly in one plane"])
def test_triangles_against_exact_arithmetic(kind):
    rng = np.random.default_rng(11)
    crossed = 0
    for _ in range(200):
        p, q = rng.integers(-2, 3, (2, 3, 3)).astype(float)
        if kind == "floats":
            p, q = rng.normal(size=(2, 3, 3)).astype(np.float32).astype(float)
        elif kind == "nearly in one plane":
            p, q = (rng.normal(size=(2, 3, 3)) * [1, 1, 1e-4]).astype(np.float32).astype(float)
        expected = exactly_cross(p, q)
        crossed += expected
        assert bool(triangles_cross(as_tuples(p), as_tuples(q))) == expected, (p, q)
    assert 10 < crossed < 190


def test_patches_miss_nothing_and_threads_change_nothing():
    rng = np.random.default_rng(5)
    meshes = []
    for _ in range(6):
        middles = rng.normal(size=(150, 1, 3))
        points = (middles + 0.3 * rng.normal(size=(150, 3, 3))).reshape(-1, 3)
        meshes.append((points, np.arange(450).reshape(-1, 3)))
    # the last two belong together
    owners = [0, 1, 2, 3, BODY, BODY]
    one, four = (crossings(*meshes, owners=owners, jobs=jobs) for jobs in (1, 4))
    for each, other in zip(one, four, strict=True):
        np.testing.assert_array_equal(each, other)
    plain = {}
    for a, b in product(range(6), repeat=2):
        if a < b and owners[a] != owners[b]:
            (p, t), (q, s) = meshes[a], meshes[b]
            low, high = p[t].min(axis=1)[:, None], p[t].max(axis=1)[:, None]
            meet = (low <= q[s].max(axis=1)) & (q[s].min(axis=1) <= high)
            near = np.argwhere(meet.all(axis=2))
            count = sum(
                bool(triangles_cross(as_tuples(p[t[i]]), as_tuples(q[s[j]]))) for i, j in near
            )
            key = tuple(sorted((owners[a], owners[b])))
            plain[key] = plain.get(key, 0) + count
    assert plain == {tuple(o): v for o, v in zip(one.owners.tolist(), one.vanes, strict=True)}
    assert one.total > 900


def test_a_cache_frame_by_frame(caches):
    done = invoke("check", "--crossings", caches["usdc"], "--frames", "2-4")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert [line.split()[-1] for line in lines] == ["2", "3", "4"]
    assert all(line.startswith("crossings: ") and " pairs at frame " in line for line in lines)
    told = invoke("check", "--crossings", caches["usda"], "--json")
    found = json.loads(told.stdout)
    assert [each["frame"] for each in found["frames"]] == [1, 2, 3, 4, 5]
    assert found["crossings"] == sum(each["crossings"] for each in found["frames"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--crossings", "--frames", "3-9"], "3-9 is out of range. Give 1 to 5"),
        (["--frames", "1-2"], "--frames needs --crossings"),
        (["--json", SAMPLES / "pigeon/body.usdc"], "--json takes one file"),
    ],
)
def test_what_cannot_be_counted_is_told(caches, options, message):
    done = invoke("check", *options, caches["usdc"])
    assert done.exit_code != 0
    assert message in " ".join(f"{done.output} {done.exception}".split())


def test_a_body_without_feathers_is_told():
    body = SAMPLES / "pigeon/body.usdc"
    with pytest.raises(InputError, match="holds no mesh with a feather's id"):
        next(count_crossings(body))
