"""Colours of feathers by a painted skin: a primvar, or a picture in its texture space."""

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, UsdGeom, Vt
from regions_skin import RADIUS, SKIN, grown, problems, region, roots, skin_folder, write_skin

from featherfx.groom.materials import linear

__all__ = ["skin_folder"]

KINDS = Sdf.ValueTypeNames


def painted(folder):
    """Red grows linearly with x as light; texture coordinates go along x and z."""
    stage = write_skin(folder)
    prim = stage.GetPrimAtPath("/skin")
    along = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get()) / (2 * RADIUS) + 0.5
    light = np.stack([along[:, 0], np.full(len(along), 0.25), np.zeros(len(along))], axis=1)
    api = UsdGeom.PrimvarsAPI(prim)
    colour = Vt.Vec3fArray.FromNumpy(light.astype(np.float32))
    api.CreatePrimvar("displayColor", KINDS.Color3fArray, "vertex").Set(colour)
    st = Vt.Vec2fArray.FromNumpy(along[:, [0, 2]].astype(np.float32))
    api.CreatePrimvar("st", KINDS.TexCoord2fArray, "vertex").Set(st)
    stage.GetRootLayer().Save()


def with_colours(value):
    return f"{SKIN}colours = '{value}'\n"


def bases(groom):
    return np.array([f.kind.colour.base for f in groom.feathers])


def test_feathers_have_the_colour_of_the_skin_where_they_stand(folder):
    painted(folder)
    groom = grown(folder, region(), skin=with_colours("displayColor"))
    light = linear(bases(groom))
    # in steps of a 64th as displays show it
    np.testing.assert_allclose(light[:, 0], roots(groom)[:, 0] / 0.2 + 0.5, atol=0.03)
    np.testing.assert_allclose(light[:, 1], 0.25, atol=0.01)
    assert len({f.kind for f in groom.feathers}) < len(groom.feathers)


def test_a_picture_paints_them_and_overrides_have_the_last_word(folder):
    painted(folder)
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32], picture[32:] = (255, 0, 64), (0, 128, 255)
    Image.fromarray(picture).save(folder / "map.png")
    last = "[overrides]\n'body_0*' = { colour.base = [1, 1, 1] }\n"
    groom = grown(folder, region(), last, skin=with_colours("map.png"))
    high, found = roots(groom)[:, 2], bases(groom)
    own = np.array([f.id.startswith("body_0") for f in groom.feathers])
    assert 0 < own.sum() < 30
    assert (found[own] == 1.0).all()
    above = found[~own & (high > 0.01)]
    np.testing.assert_allclose(above, np.tile([1, 0, 0.25], (len(above), 1)), atol=0.01)
    below = found[~own & (high < -0.01)]
    np.testing.assert_allclose(below, np.tile([0, 0.5, 1], (len(below), 1)), atol=0.01)
    plain = grown(folder, region())
    assert roots(plain) == pytest.approx(roots(groom))
    assert all(f.kind.colour.base is None for f in plain.feathers)


def test_paint_that_is_not_there_is_told(folder):
    painted(folder)
    told = problems(folder, region(), skin=with_colours("displayColour"))
    assert "skin.colours: no primvar 'displayColour' on /skin" in told
    assert "did you mean 'displayColor'" in told
    assert "there is no such file" in problems(folder, region(), skin=with_colours("no.png"))
    assert "top" in problems(folder, region(), skin=with_colours("top"))
