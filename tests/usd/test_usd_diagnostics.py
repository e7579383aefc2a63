"""Strain and energy per face against Green-Lagrange strain of an affine map, and how they stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import feathers
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation

from featherfx.errors import InputError
from featherfx.feather.types import RACHIS_PART, RowPoints, both, turned
from featherfx.usd.check.check import check_usd
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

STIFFNESS = (5.76, 3.36)  # N/m
NAMES = ("strainAcross", "strainShear", "energyDensity")
LINEAR = np.array([[1.02, 0.05, 0.0], [-0.01, 1.1, 0.0], [0.03, 0.04, 1.0]])
TURN = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()


def affine(points: RowPoints, linear: np.ndarray) -> RowPoints:
    return turned(linear.T, points)


def write(path: Path, layout: str, diagnostics=("strain", "energy"), **options) -> Path:
    """One feather: at rest, stretched by LINEAR, turned, both; and one that never moves."""
    entry = replace(feathers.entries()[0], vane_stiffness=STIFFNESS)
    still = replace(feathers.entries()[3], vane_stiffness=STIFFNESS)
    rest = entry.rest_points
    poses = [np.eye(3), LINEAR, TURN, TURN @ LINEAR]
    with CacheWriter(
        path,
        [entry, still],
        (1, 4),
        options=WriteOptions(layout=layout, chunk=2, diagnostics=diagnostics, **options),
    ) as writer:
        for number, linear in enumerate(poses, start=1):
            zero = both(np.zeros_like, rest)
            points = (affine(rest, linear), still.rest_points)
            writer.write(feathers.frame_of(number, number / 24, points, (zero, zero)))
    return path


def values(path: Path, code: float | None, feather: int = 0) -> list[np.ndarray]:
    stage = Usd.Stage.Open(str(path))
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    at = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
    api = UsdGeom.PrimvarsAPI(meshes[feather])
    return [np.array(api.GetPrimvar(name).Get(at)) for name in NAMES]


def exact() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """E = (F^T F - 1) / 2 in the barb frame: v along the barb, w in the vane, to the tip."""
    surface = feathers.surface()
    green = 0.5 * (LINEAR.T @ LINEAR - np.eye(3))
    v = surface.barb_direction
    w = np.cross([0.0, 0.0, 1.0], v)
    w *= np.sign(w[:, :1])
    vane = surface.part != RACHIS_PART
    across = np.where(vane, np.einsum("ti,ij,tj->t", w, green, w), 0.0)
    shear = np.where(vane, np.einsum("ti,ij,tj->t", v, green, w), 0.0)
    density = 0.5 * (STIFFNESS[0] * across**2 + 4.0 * STIFFNESS[1] * shear**2)
    return across, shear, density


@pytest.mark.verification
@pytest.mark.parametrize("layout", ["flat", "payload", "clips"])
def test_affine_maps_have_their_strain(tmp_path, layout):
    path = write(tmp_path / "cache.usda", layout, up_axis="Y", meters_per_unit=0.01)
    across, shear, _ = exact()
    assert len(np.unique(across.round(6))) == 3, "two vanes, and the shaft"
    assert shear.min() < -0.04
    for code in (2.0, 4.0):
        for found, wanted in zip(values(path, code), exact(), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-8)


def test_rest_and_rigid_motion_have_none(tmp_path):
    path = write(tmp_path / "cache.usdc", "clips")
    for code in (None, 1.0, 3.0):
        for found in values(path, code):
            assert np.abs(found).max() < 1e-12
    for found in values(path, None, feather=1):
        assert np.abs(found).max() < 1e-12


@pytest.mark.parametrize("layout", ["flat", "payload", "clips"])
def test_caches_with_diagnostics_are_sound(tmp_path, layout):
    path = write(tmp_path / "cache.usda", layout)
    assert check_usd(path) == []
    stage = Usd.Stage.Open(str(path))
    moving, still = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    for name in NAMES:
        primvar = UsdGeom.PrimvarsAPI(moving).GetPrimvar(name)
        assert primvar.GetInterpolation() == "uniform"
        assert primvar.GetAttr().GetTimeSamples() == [1.0, 2.0, 3.0, 4.0]
        assert UsdGeom.PrimvarsAPI(still).GetPrimvar(name).GetAttr().GetNumTimeSamples() == 0


def test_only_what_is_asked_for_is_written(tmp_path):
    def written(path: Path) -> set[str]:
        stage = Usd.Stage.Open(str(path))
        mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
        names = {p.GetPrimvarName() for p in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues()}
        return names & set(NAMES)

    assert written(write(tmp_path / "none.usdc", "flat", ())) == set()
    assert written(write(tmp_path / "strain.usdc", "flat", ("strain",))) == set(NAMES[:2])
    assert written(write(tmp_path / "energy.usdc", "flat", ("energy",))) == {NAMES[2]}


def test_an_unknown_diagnostic_is_refused(tmp_path):
    with pytest.raises(InputError, match="'stress' is not one of strain, energy"):
        write(tmp_path / "cache.usdc", "flat", ("stress",))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.Set([float("nan")] * len(a.Get(2)), 2), "not finite"),
        (lambda a: a.Set([0.0], 2), "Interpolation uniform asks for"),
        (lambda a: a.ClearAtTime(2), "not at the times of the"),
    ],
)
def test_broken_diagnostics_are_found(tmp_path, change, message):
    path = write(tmp_path / "cache.usda", "flat")
    stage = Usd.Stage.Open(str(path))
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    change(mesh.GetAttribute("primvars:strainShear"))
    stage.Save()
    found = [p for p in check_usd(path) if p.key.endswith("primvars:strainShear")]
    assert any(message in problem.message for problem in found)
