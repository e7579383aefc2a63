"""Barbules as curves: they close the vane between barbs, and move with these."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

import featherfx
from featherfx.baking.pipeline import export_groom
from featherfx.errors import InputError
from featherfx.feather.barb_looks import barbed_feather
from featherfx.usd.check.check import check_usd

BARBULES = 40
GROOM = """name = "vanes"
[[feather]]
id = "primary"
kind = "primary"
position = [0, 0, 0]
[[feather]]
id = "contour"
kind = "body_contour"
position = [0, 0.1, 0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cache of each feather with as many barbs as it has, and a shot."""
    made = tmp_path_factory.mktemp("barbules")
    (made / "groom.toml").write_text(GROOM)
    for feather in featherfx.read_groom(made / "groom.toml").feathers:
        own = f'{GROOM.partition("[[")[0]}[[feather]]\nid = "a"\nkind = "{feather.kind.name}"\n'
        (made / f"{feather.id}.toml").write_text(f"{own}position = [0, 0, 0]\n")
        export_groom(
            made / f"{feather.id}.toml", made / f"{feather.id}.usdc",
            barbs=feather.kind.barb_count, barbules=BARBULES,
        )  # fmt: skip
    return made


def ribbons(prim):
    """Corners (V, 3) and triangles (T, 3) of curves as flat ribbons across their normals."""
    curves = UsdGeom.BasisCurves(prim)
    points, widths, normals = (
        np.array(each.Get(), float)
        for each in (curves.GetPointsAttr(), curves.GetWidthsAttr(), curves.GetNormalsAttr())
    )
    counts = np.array(curves.GetCurveVertexCountsAttr().Get())
    ends = np.cumsum(counts)
    last = np.zeros(len(points), bool)
    last[ends - 1] = True
    tangent = np.gradient(points, axis=0)
    tangent[last] = points[last] - points[np.flatnonzero(last) - 1]
    first = ends - counts
    tangent[first] = points[first + 1] - points[first]
    beside = np.cross(normals, tangent)
    beside *= 0.5 * widths[:, None] / np.linalg.norm(beside, axis=1, keepdims=True)
    corners = np.concatenate([points - beside, points + beside])
    a = np.flatnonzero(~last)
    b, n = a + 1, len(points)
    return corners, np.concatenate(
        [np.stack(each, 1) for each in ((a, b, b + n), (a, b + n, a + n))]
    )


def met(corners, triangles, starts, ways):
    """Whether rays meet triangles."""
    scenes = pytest.importorskip("embreex.rtcore_scene")
    meshes = pytest.importorskip("embreex.mesh_construction")
    scene = scenes.EmbreeScene()
    meshes.TriangleMesh(scene, corners.astype(np.float32), triangles.astype(np.int32))
    return scene.run(starts.astype(np.float32), ways.astype(np.float32)) >= 0


@pytest.mark.parametrize("feather", ["primary", "contour"])
@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_a_vane_of_curves_is_as_opaque_as_its_mesh(folder, feather, slope):
    """Rays through random places of the vane, along its normal and aslant."""
    stage = Usd.Stage.Open(str(folder / f"{feather}.usdc"))
    mesh = UsdGeom.Mesh.Get(stage, f"/{feather}/feathers/a")
    points = np.array(mesh.GetPointsAttr().Get(), float)
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    vane = faces[np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("side").Get()) < 2]
    a, b, c = np.moveaxis(points[vane], 1, 0)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    random = np.random.default_rng(3)
    face = random.choice(len(area), 4000, p=area / area.sum())
    share = random.dirichlet(np.ones(3), len(face))[..., None]
    place = share[:, 0] * a[face] + share[:, 1] * b[face] + share[:, 2] * c[face]
    normal = normal[face] / area[face, None]
    around = random.normal(size=normal.shape)
    around -= (around * normal).sum(1, keepdims=True) * normal
    ways = -normal + slope * around / np.linalg.norm(around, axis=1, keepdims=True)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = place - 2e-3 * ways
    prim = stage.GetPrimAtPath(f"/{feather}/barbs/a_barbs")
    opacity = {
        "mesh": met(points, vane, starts, ways).mean(),
        "curves": met(*ribbons(prim), starts, ways).mean(),
    }
    assert opacity["mesh"] > 0.999
    assert opacity["curves"] == pytest.approx(opacity["mesh"], abs=0.05)
    # the barbs alone are a comb
    corners, triangles = ribbons(prim)
    sorts = np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("barbule").Get())
    counts = np.array(UsdGeom.BasisCurves(prim).GetCurveVertexCountsAttr().Get())
    of_barbs = np.repeat(sorts == 0, counts)
    alone = met(corners, triangles[of_barbs[triangles[:, 0] % len(of_barbs)]], starts, ways)
    assert alone.mean() < 0.3


def test_barbules_have_what_their_barb_has(folder):
    stage = Usd.Stage.Open(str(folder / "primary.usdc"))
    prim = stage.GetPrimAtPath("/primary/barbs/a_barbs")
    primvars = UsdGeom.PrimvarsAPI(prim)
    read = {
        name: np.array(primvars.GetPrimvar(name).Get())
        for name in ("barbule", "barbId", "barbIndex", "rootUv", "side", "hooked", "ramus", "st")
    }
    counts = np.array(UsdGeom.BasisCurves(prim).GetCurveVertexCountsAttr().Get())
    assert set(counts[read["barbule"] == 0]) == {9}
    assert set(counts[read["barbule"] > 0]) == {3}
    assert all(len(read[name]) == len(counts) for name in ("barbule", "barbId", "rootUv", "side"))
    assert all(len(read[name]) == counts.sum() for name in ("hooked", "ramus", "st"))
    barbs = read["barbule"] == 0
    of_barb = dict(zip(read["barbId"][barbs], read["barbIndex"][barbs], strict=True))
    assert [of_barb[each] for each in read["barbId"]] == read["barbIndex"].tolist()
    for sort in (1, 2):  # on every barb that has a neighbour there
        _, number = np.unique(read["barbId"][read["barbule"] == sort], return_counts=True)
        assert set(number) == {BARBULES}
        assert len(number) == barbs.sum() - 2
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    assert material.GetPath() == "/primary/materials/barb"
    assert check_usd(folder / "primary.usdc") == []


@pytest.mark.parametrize("mirrored", [False, True])
def test_distal_barbules_lead_to_the_next_barb_and_all_forward_at_45_degrees(folder, mirrored):
    kind = featherfx.read_groom(folder / "groom.toml").feathers[0].kind
    barbs = barbed_feather(kind, (41, 6), 60, mirrored, "a", 12)
    own = barbs.barbules
    points = barbs.drawn(barbs.points.reshape(-1, 3))[barbs.points[..., 0].size :].reshape(-1, 3, 3)
    for sort, other in zip((2, 1), barbs.neighbours, strict=True):
        mine = own.sort == sort
        for k, far in ((0, False), (2, True)):
            on = other[own.barb[mine]] if far else own.barb[mine]
            away = [
                np.linalg.norm(np.cross(np.diff(curve, axis=0), point - curve[:-1]), axis=1)
                / np.linalg.norm(np.diff(curve, axis=0), axis=1)
                for curve, point in zip(barbs.points[on], points[mine, k], strict=True)
            ]
            assert np.min(away, axis=1).max() < 1e-9
        nearest = np.linalg.norm(barbs.points[own.barb[mine]] - points[mine, :1], axis=2).argmin(1)
        along = np.gradient(barbs.points, axis=1)[own.barb[mine], nearest]
        way = points[mine, 2] - points[mine, 0]
        sizes = np.linalg.norm(along, axis=1) * np.linalg.norm(way, axis=1)
        angle = np.degrees(np.arccos((along * way).sum(axis=1) / sizes))
        assert np.percentile(angle, [25, 50, 75]) == pytest.approx([45.0] * 3, abs=4.0)


def test_barbules_move_with_their_barbs(tmp_path, folder):
    """Points and velocities of a bake are the means of the barbs' that they are at rest."""
    (tmp_path / "shot.toml").write_text(
        f'name = "s"\ngroom = "{(folder / "primary.toml").as_posix()}"\nframes = [1, 3]\n'
        "quality = { base = 'draft', rows = 11, columns = 2 }\n"
        "wind = { speed = 8, gust = 0.5, direction = [1, 0, 1] }\n"
    )
    featherfx.bake(tmp_path / "shot.toml", tmp_path / "s.usdc", barbs=20, barbules=4)
    stage = Usd.Stage.Open(str(tmp_path / "s.usdc"))
    curves = UsdGeom.BasisCurves.Get(stage, "/s/barbs/a_barbs")
    kind = featherfx.read_groom(folder / "primary.toml").feathers[0].kind
    barbs = barbed_feather(kind, (11, 2), 20, False, "a", 4)
    for attribute in (curves.GetPointsAttr(), curves.GetVelocitiesAttr()):
        values = np.array(attribute.Get(3), float)
        size = barbs.widths.size
        wanted = barbs.drawn(values[:size])
        scale = np.ptp(values, axis=0).max()
        assert scale > 0.0
        assert values == pytest.approx(wanted, abs=1e-6 * scale)
    assert check_usd(tmp_path / "s.usdc") == []


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("primary", {}, "barbules: needs barbs. Give --barbs N, too"),
        ("contour", {"barbs": 20}, "vanes of the kind 'contour' may split"),
    ],
)
def test_barbules_that_cannot_be_are_told(folder, tmp_path, kind, options, message):
    groom = tmp_path / "groom.toml"
    split = "overrides = { leading.splits.count = 2 }\n" if options else ""
    own = (folder / "primary.toml").read_text().replace('"primary"', f'"{kind}"')
    groom.write_text(own + split)
    with pytest.raises(InputError, match=message) as error:
        export_groom(groom, tmp_path / "g.usdc", barbules=4, **options)
    assert len(error.value.problems) == 1
