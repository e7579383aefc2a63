"""Materials of caches: MaterialX accepts their nodes, and pigments are data beside the colours."""

from __future__ import annotations

import numpy as np
import pytest
from places import COARSE
from pxr import Usd, UsdGeom, UsdShade

import featherfx
from featherfx.errors import InputError
from featherfx.groom.materials import ABSORPTION, VANE_COLOUR, filtered
from featherfx.usd.check.check import check_usd

GROOM = """name = "pigments"
[[feather]]
id = "brown"
kind = "covert"
position = [0, 0, 0]
[feather.overrides.colour]
eumelanin = 0.5
barbule_tilt = 12
film = 5e-7
patterns = [{ kind = "bars", pheomelanin = 0.8, count = 2, soft = 0.01, film = 0 }]
[[feather]]
id = "plain"
kind = "covert"
position = [0, 0.2, 0]
"""
VARIANTS = [("vane", ""), ("rachis", ""), ("barb", "hair"), ("barb", "surface")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("materials")
    (made / "plain.toml").write_text(GROOM.partition("[feather.overrides")[0])
    (made / "film.toml").write_text(GROOM)
    for name in ("plain", "film"):
        shot = f'name = "s"\ngroom = "{name}.toml"\nframes = [1, 1]\n{COARSE}'
        (made / "shot.toml").write_text(shot)
        featherfx.bake(made / "shot.toml", made / f"{name}.usdc", barbs=12)
    return made


def in_materialx(material):
    """The MaterialX document of a material's nodes, each by its definition."""
    mx = pytest.importorskip("MaterialX")
    document = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), document)
    surface, _, _ = material.ComputeSurfaceSource("mtlx")
    made = {}

    def add(shader):
        name = shader.GetPrim().GetName()
        if name in made:
            return made[name]
        definition = document.getNodeDef(shader.GetIdAttr().Get())
        assert definition is not None, shader.GetIdAttr().Get()
        made[name] = node = document.addNodeInstance(definition, name)
        for given in shader.GetInputs():
            wanted = definition.getActiveInput(given.GetBaseName())
            assert wanted is not None, given.GetFullName()
            own = node.addInput(given.GetBaseName(), wanted.getType())
            sources, _ = given.GetConnectedSources()
            if not sources:
                value = given.Get()
                text = mx.createValueFromStrings
                value = (
                    str(value).strip("()@") if not isinstance(value, bool) else str(value).lower()
                )
                assert text(value, wanted.getType()) is not None, (given.GetFullName(), value)
                own.setValueString(value)
            else:
                (source,) = sources
                other = add(UsdShade.Shader(source.source.GetPrim()))
                outputs = document.getNodeDef(source.source.GetPrim().GetAttribute("info:id").Get())
                found = outputs.getActiveOutput(source.sourceName)
                assert found.getType() == wanted.getType(), given.GetFullName()
                own.setNodeName(other.getName())
                if len(outputs.getActiveOutputs()) > 1:
                    own.setOutputString(source.sourceName)
        return node

    shader = add(surface)
    document.addMaterialNode("made", shader)
    return document


@pytest.mark.parametrize("cache", ["plain", "film"])
@pytest.mark.parametrize(("name", "variant"), VARIANTS)
def test_materialx_accepts_every_material(folder, cache, name, variant):
    stage = Usd.Stage.Open(str(folder / f"{cache}.usdc"))
    material = UsdShade.Material.Get(stage, f"/{cache}/materials/{name}")
    variants = material.GetMaterialVariant()
    assert variants.GetVariantNames() == (["hair", "surface"] if variant else [])
    if variant:
        stage.SetEditTarget(stage.GetSessionLayer())
        variants.SetVariantSelection(variant)
    document = in_materialx(material)
    valid, message = document.validate()
    assert valid, message
    (made,) = document.getMaterialNodes()
    (shader,) = (
        made.getConnectedNodes()
        if hasattr(made, "getConnectedNodes")
        else [made.getInput("surfaceshader").getConnectedNode()]
    )
    is_hair = variant == "hair"
    assert shader.getCategory() == ("surface" if is_hair else "standard_surface")
    assert bool(document.getNodes("chiang_hair_bsdf")) == is_hair
    assert check_usd(folder / f"{cache}.usdc") == []


def test_curves_are_bound_to_the_hair(folder):
    stage = Usd.Stage.Open(str(folder / "plain.usdc"))
    prim = stage.GetPrimAtPath("/plain/barbs/brown_barbs")
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource("mtlx")
    assert surface.GetIdAttr().Get() == "ND_surface"


def test_melanins_absorb_as_those_of_materialx():
    """The colours of its melanin node's inputs are those of hair of unit concentration."""
    mx = pytest.importorskip("MaterialX")
    document = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), document)
    node = document.getNodeDef("ND_deon_hair_absorption_from_melanin")
    for name in ("eumelanin", "pheomelanin"):
        wanted = [*node.getActiveInput(f"{name}_color").getValue()]
        assert np.exp(-np.array(ABSORPTION[name])) == pytest.approx(wanted, rel=2e-3)


def test_colours_follow_from_pigments_and_these_are_primvars(folder):
    stage = Usd.Stage.Open(str(folder / "film.usdc"))
    for part, end in (("feathers", ""), ("barbs", "_barbs")):
        found = {}
        for feather in ("brown", "plain"):
            primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f"/film/{part}/{feather}{end}"))
            names = ("displayColor", "eumelanin", "pheomelanin", "barbuleTilt", "filmThickness")
            found[feather] = [np.array(primvars.GetPrimvar(name).Get()) for name in names]
            assert not primvars.HasPrimvar("carotenoid")  # no feather has it
            assert primvars.GetPrimvar("eumelanin").GetInterpolation() == "vertex"
        shown, brown, rufous, tilt, film = found["brown"]
        assert set(np.unique(brown)) == {np.float32(0.5)}
        assert set(np.unique(tilt)) <= {0.0, 12.0}
        assert (rufous > 0.79).any()
        assert (rufous == 0.0).any()
        vane = tilt > 0.0
        assert set(film[vane]) == {0.0, 500.0}
        left = 0.5 ** np.array(ABSORPTION["eumelanin"]) * np.array(VANE_COLOUR)
        assert shown[vane & (rufous == 0.0)] == pytest.approx(
            np.tile(left, ((vane & (rufous == 0.0)).sum(), 1)), rel=1e-5
        )
        amounts = {
            "eumelanin": brown[vane].astype(float),
            "pheomelanin": rufous[vane].astype(float),
        }
        keratin = np.tile(VANE_COLOUR, (vane.sum(), 1))
        assert shown[vane] == pytest.approx(filtered(keratin, amounts), rel=1e-4)
        assert all((each == 0.0).all() for each in found["plain"][1:])


@pytest.mark.parametrize("pigment", ["eumelanin", "pheomelanin", "carotenoid"])
def test_more_pigment_is_darker_and_bluest_light_goes_first(pigment):
    amounts = np.linspace(0.0, 1.0, 9)
    light = filtered(np.ones((9, 3)), {pigment: amounts})
    assert (np.diff(light, axis=0) <= 0.0).all()
    assert (np.diff(light, axis=0)[:, 2] < 0.0).all()
    assert (np.diff(light[1:], axis=1) < 0.0).all()


@pytest.mark.parametrize(
    ("colour", "message"),
    [
        ("eumelanin = 1.5", "overrides.colour.eumelanin: 1.5 is out of range. Give 0 to 1"),
        (
            'patterns = [{ kind = "bars" }]',
            "patterns[0].colour: missing. Give a colour, or one of film, barbule_tilt, eumelanin",
        ),
    ],
)
def test_pigments_that_cannot_be_are_told_once(tmp_path, colour, message):
    groom = tmp_path / "groom.toml"
    groom.write_text(GROOM.replace("eumelanin = 0.5", colour).partition("barbule_tilt")[0])
    with pytest.raises(InputError) as error:
        featherfx.read_groom(groom)
    assert str(error.value).count(message) == 1
    assert len(error.value.problems) == 1
