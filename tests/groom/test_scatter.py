"""Blue noise on a skin: distances, densities, and what stays when the density changes."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.space import Space
from featherfx.groom.regions.rules import GroomSkin, Presence, presence
from featherfx.groom.regions.scatter import expected_count, hashed, scatter, uniform
from featherfx.groom.skin.points import SkinSurface, crossing_triangles

RADIUS = 0.2


def surface_of(mesh):
    triangles = np.array(mesh.faces, dtype=np.int64)
    source = SimpleNamespace(
        path="/skin",
        points=np.array(mesh.vertices, dtype=float),
        triangles=triangles,
        st=None,
        own_matrix=np.eye(4),
        stage_matrix=np.eye(4),
    )
    return SkinSurface(source)


@pytest.fixture(scope="module")
def sphere():
    return surface_of(trimesh.creation.icosphere(3, radius=RADIUS))


def everywhere(points):
    return np.ones(len(points))


def test_points_lie_on_the_skin_with_its_normals(sphere):
    points = scatter(Presence(sphere, (everywhere,)), 300, 5).points
    radii = np.linalg.norm(points.position, axis=1)
    assert (radii <= RADIUS).all()
    # an icosphere's faces lie inside the sphere by their sagitta
    assert (radii > 0.99 * RADIUS).all()
    outward = points.position / radii[:, None]
    assert np.einsum("nc,nc->n", outward, points.normal).min() > 0.999


def test_spacing_is_that_of_blue_noise(sphere):
    count = 2000
    points = scatter(Presence(sphere, (everywhere,)), count, 1).points.position
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    # a full dart-throwing pattern has 0.7 points per squared distance; random points are at
    # 0.5 / sqrt(density) on average, and as near as chance has it
    full = np.sqrt(0.7 * sphere.areas.sum() / count)
    assert nearest.min() > 0.75 * full
    assert nearest.mean() > 0.5 / np.sqrt(count / sphere.areas.sum()) * 1.5


def test_a_denser_scatter_keeps_the_points_of_a_sparser_one(sphere):
    sparse, dense = (scatter(Presence(sphere, (everywhere,)), count, 3) for count in (400, 1500))
    assert np.array_equal(dense.number[:400], sparse.number)
    assert np.array_equal(dense.points.position[:400], sparse.points.position)


def test_density_follows_its_map(sphere):
    def share(points):
        return 0.5 + 0.5 * points.position[:, 2] / RADIUS

    found = scatter(Presence(sphere, (share,)), 4000, 2).points.position[:, 2] / RADIUS
    # z is uniform on a sphere: below -0.5, 0 and 0.5 lie the integrals of (1 + z) / 2 over dz
    for height in (-0.5, 0.0, 0.5):
        expected = (height + 1.0) ** 2 / 4.0
        assert abs((found < height).mean() - expected) < 0.015


def test_bounds_of_a_region_leave_its_points_as_they_are(sphere):
    def cap(points):
        return (points.position[:, 0] > 0.5 * RADIUS).astype(float)

    def bound(surface, triangles):
        return surface.corners[triangles, :, 0].max(axis=1) - 0.5 * RADIUS

    free, bounded = (scatter(Presence(sphere, (cap,), each), 500, 3) for each in ((), (bound,)))
    assert np.array_equal(free.number, bounded.number)
    assert np.array_equal(free.points.position, bounded.points.position)


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sphere", {"centre": (0.11, 0.0, 0.0), "radius": 0.03}),
        ("x", (0.08, 0.3)),
        ("nearest", {"to": [(0.1, 0.1, 0.1)], "than": [(-0.1, 0.0, 0.0)]}),
    ],
)
def test_no_triangle_is_left_out_that_a_region_reaches(name, value, invert):
    plate = surface_of(trimesh.creation.box((0.2, 0.2, 0.02)).subdivide().subdivide())
    rule = dict.fromkeys(("primvar", "subset", "image", "facing", "free_radius", "sphere", "x"))
    rule |= dict.fromkeys(("box", "y", "z", "nearest")) | {"soft": 0.01, "invert": invert}
    rule[name] = value
    space = Space(np.eye(3), 1.0, np.zeros(3), np.array([0.0, 1.0, 0.0]), False)
    skin = GroomSkin(plate, space, Path())
    found = presence((rule,), skin, Place("groom.toml", "where", Problems()))
    places = np.random.default_rng(1).dirichlet(np.ones(3), 6000)
    points = plate.at(np.arange(6000) % len(plate.areas), places)
    whole = Presence(plate, found.rules)(points)
    assert 0.0 < whole.mean() < 1.0
    assert np.array_equal(found(points), whole)
    assert invert or not found.reached(1e-3, 0.0, False).all()


def test_integral_of_a_density(sphere):
    def density(points):
        return 1e4 * (1.0 + points.position[:, 0] / RADIUS)

    # the odd part cancels
    assert expected_count(sphere, density) == pytest.approx(1e4 * sphere.areas.sum(), rel=1e-6)


def test_no_room_gives_what_there_is(sphere):
    assert (
        len(scatter(Presence(sphere, (lambda points: np.zeros(len(points)),)), 50, 1).number) == 0
    )
    assert len(scatter(Presence(sphere, (everywhere,)), 0, 1).number) == 0


def test_both_sides_of_a_thin_plate_are_covered():
    plate = surface_of(trimesh.creation.box((0.2, 0.2, 0.001)))
    points = scatter(Presence(plate, (everywhere,)), 800, 4).points
    assert abs((points.normal[:, 2] > 0.5).mean() - 0.5) < 0.05


def test_hashes_are_the_same_on_every_machine():
    # splitmix64 of seed 0 and stream 0 has the finaliser of the published generator
    words = hashed(0, 0, np.array([1, 2, 3]))
    assert [f"{int(word):016x}" for word in words] == [
        "e220a8397b1dcdaf",
        "6e789e6aa1b965f4",
        "06c45d188009454f",
    ]
    values = uniform(1, 2, np.arange(10_000))
    assert 0.0 < values.min() < values.max() < 1.0
    assert abs(values.mean() - 0.5) < 0.02


def test_faces_that_pass_through_each_other():
    first, second = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((1.0, 1.0, 1.0))
    second.apply_translation((0.7, 0.13, 0.17))
    both = trimesh.util.concatenate(first, second)
    points, faces = np.array(both.vertices), np.array(both.faces, dtype=np.int64)
    pairs = crossing_triangles(points, faces)
    assert len(pairs)
    half = len(first.faces)
    assert ((pairs < half).sum(axis=1) == 1).all()
    second.apply_translation((2.0, 0.0, 0.0))
    apart = trimesh.util.concatenate(first, second)
    assert len(crossing_triangles(np.array(apart.vertices), np.array(apart.faces))) == 0
