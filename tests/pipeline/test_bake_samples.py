"""Subframes, accelerations and the time codes at which they stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES
from pxr import Usd, UsdGeom

import featherfx

PULL = SAMPLES / "feather_pull/shot.toml"


_OPEN = []


def mesh(path: Path) -> UsdGeom.Mesh:
    """The only mesh of a cache."""
    stage = Usd.Stage.Open(str(path))
    _OPEN.append(stage)  # a prim does not keep its stage alive
    (found,) = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    return found


@pytest.fixture(scope="module")
def fine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fine") / "pull.usdc"
    featherfx.bake(
        PULL, path, frames=(2, 13), subframes=3, accelerations=True, layout="clips", chunk=5
    )
    return path


def test_subframes_stand_at_exact_fractions(fine):
    moving = mesh(fine)
    codes = moving.GetPointsAttr().GetTimeSamples()
    assert codes == [2 + k // 3 if k % 3 == 0 else 2 + k // 3 + (k % 3) / 3 for k in range(34)]
    assert moving.GetVelocitiesAttr().GetTimeSamples() == codes


def test_subframes_are_stepped_not_interpolated(tmp_path, fine):
    """At whole frames both agree within the solver's tolerance; between, motion is curved."""
    coarse = tmp_path / "pull.usdc"
    featherfx.bake(PULL, coarse, frames=(2, 13))
    meshes = mesh(coarse), mesh(fine)
    one, many = (each.GetPointsAttr() for each in meshes)
    for code in (3, 7, 13):
        np.testing.assert_allclose(many.Get(code), one.Get(code), atol=1.5e-3)
    bend = np.abs(np.array(many.Get(6 + 1 / 3)) - np.array(one.Get(6 + 1 / 3))).max()
    assert bend > 1e-5


def test_rates_belong_to_the_points(fine):
    moving = mesh(fine)
    points, velocities = moving.GetPointsAttr(), moving.GetVelocitiesAttr()
    accelerations = moving.GetAccelerationsAttr()
    step = 1 / 72
    assert accelerations.GetTimeSamples() == points.GetTimeSamples()
    for code in (5, 7, 9):  # from frame 10 on the vane snaps into wrinkles within a sample
        around = (code - 1 + 2 / 3, code + 1 / 3)  # samples stand at thirds of a frame
        before, after = (np.array(points.Get(c)) for c in around)
        speed = np.array(velocities.Get(code))
        assert np.abs((after - before) / (2 * step) - speed).max() < 0.1 * np.abs(speed).max()
        before, after = (np.array(velocities.Get(c)) for c in around)
        change, second = (after - before) / (2 * step), np.array(accelerations.Get(code))
        cosine = (change * second).sum() / np.linalg.norm(change) / np.linalg.norm(second)
        assert cosine > 0.9


def test_a_plain_cache_has_no_accelerations(tmp_path):
    path = tmp_path / "pull.usdc"
    featherfx.bake(PULL, path, frames=(1, 2))
    plain = mesh(path)
    assert not plain.GetAccelerationsAttr().HasAuthoredValue()


def test_accelerations_are_second_differences_of_the_points(tmp_path):
    """a = (p(t + h) - 2 p(t) + p(t - h)) / h^2 + O(h^2): far closer at a quarter of the step."""
    (tmp_path / "groom.toml").write_text(
        'name = "one"\n[[feather]]\nid = "a"\nkind = "swan_primary"\nposition = [0, 0, 0]\n'
        "direction = [1, 0, 0]\nup = [0, 0, 1]\n"
    )
    shot = tmp_path / "shot.toml"
    shot.write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 7]\nframes_per_second = 24\n'
        'motion = "shake"\nwind = "calm"\nquality = "preview"\n'
    )
    errors = []
    # at 32 the rounding of written points is as much
    for subframes in (4, 16):
        path = tmp_path / f"s{subframes}.usdc"
        featherfx.bake(shot, path, subframes=subframes, accelerations=True)
        moving, step = mesh(path), 1 / (24 * subframes)
        codes = moving.GetPointsAttr().GetTimeSamples()
        points = np.array([moving.GetPointsAttr().Get(code) for code in codes], dtype=float)
        given = np.array([moving.GetAccelerationsAttr().Get(code) for code in codes])
        found = (points[2:] - 2 * points[1:-1] + points[:-2]) / step**2
        late = slice(3 * subframes, None)  # from rest to the shake
        apart = np.sqrt(((found - given[1:-1])[late] ** 2).mean())
        errors.append(apart / np.sqrt((found[late] ** 2).mean()))
    assert errors[1] < 0.005
    assert errors[1] < errors[0] / 10
