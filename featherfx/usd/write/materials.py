"""Materials of a cache: UsdPreviewSurface, and MaterialX beside it.

Vanes and rachises are standard_surface. Barbs, as curves, have the variants "hair" (Chiang et al.
2016, doi:10.1111/cgf.12830) and "surface" of USD's variant set of materials. Colours are those of
the textures, else of displayColor, else of keratin. UsdPreviewSurface and hair have no film.

A USD that was built without MaterialX does not know its nodes, and its validators report them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any, NamedTuple

from pxr import Gf, Sdf, UsdGeom, UsdShade

from featherfx.groom.looks import RACHIS_COLOUR, VANE_COLOUR
from featherfx.usd.types import FeatherEntry

_TYPES = Sdf.ValueTypeNames
MATERIAL_COLOURS = {"vane": VANE_COLOUR, "rachis": RACHIS_COLOUR, "barb": VANE_COLOUR}
MATERIAL_ROUGHNESS = {"vane": 0.65, "rachis": 0.4, "barb": 0.65}
# of the vanes' light, what goes through: as in pictures (featherfx/render/light_kernels.py)
_THROUGH = 0.34
# where there is a film: index of what is below it (that of the film is the shader's default), and
# roughness; chosen by eye
_BELOW_FILM, _PLAIN, _FILM_ROUGHNESS = 2.0, 1.5, 0.3
# of hair: roughness along it and around it, those of MaterialX; keratin's index (Brink and van der
# Berg 2004, J. Phys. D 37: 813), and no scales, as barbs have none
_ALONG_HAIR, _AROUND_HAIR, _KERATIN, _NO_SCALES = 0.1, 0.2, 1.56, 0.5


class MaterialInputs(NamedTuple):
    """Inputs of the materials.

    coloured: displayColor. film: filmThickness. texture: name of the images, whose coordinates are
    the primvar atlas; empty: none.
    """

    coloured: bool = False
    film: bool = False
    texture: str = ""


def choose_inputs(entries: Sequence[FeatherEntry], texture: str = "") -> MaterialInputs:
    """Return the material inputs that feathers have."""
    found = [entry.colours for entry in entries if entry.colours is not None]
    coloured = len(found) == len(entries)
    return MaterialInputs(coloured, coloured and "film" in found[0].shading, texture)


def define_materials(
    stage: Any, scope: Any, look: MaterialInputs, with_barbs: bool = False
) -> dict[str, Any]:
    """Define the materials under the path scope; return them by name."""
    UsdGeom.Scope.Define(stage, scope)
    made = {}
    for name in MATERIAL_COLOURS if with_barbs else ("vane", "rachis"):
        material = UsdShade.Material.Define(stage, scope.AppendChild(name))
        # rachises are outside of the charts
        own = MaterialInputs(look.coloured) if name == "rachis" else look
        nodes = MaterialNodes(stage, material.GetPath())
        material.CreateSurfaceOutput().ConnectToSource(_preview_surface(nodes, name, own))
        shaders = _BARB_SHADERS if name == "barb" else {"": _standard_surface}
        variants = material.GetMaterialVariant()
        for variant, shader in shaders.items():
            with contextlib.ExitStack() as context:
                if variant:
                    variants.AddVariant(variant)
                    variants.SetVariantSelection(variant)
                    context.enter_context(variants.GetVariantEditContext())
                output = material.CreateSurfaceOutput("mtlx")
                output.ConnectToSource(shader(nodes, name, own))
        made[name] = material
    return made


class MaterialNodes:
    """Shaders of a material."""

    def __init__(self, stage: Any, path: Any) -> None:
        self._stage, self._path = stage, path

    def add(self, name: str, id: str, output: tuple[str, Any], **inputs: tuple[Any, Any]) -> Any:
        """Add a shader and return its output. inputs: type, and value or another's output."""
        shader = UsdShade.Shader.Define(self._stage, self._path.AppendChild(name))
        shader.CreateIdAttr(id)
        for each, (kind, value) in inputs.items():
            put = shader.CreateInput(each, kind)
            if isinstance(value, UsdShade.Output):
                put.ConnectToSource(value)
            else:
                put.Set(value)
        return shader.CreateOutput(*output)


def _preview_surface(nodes: MaterialNodes, name: str, look: MaterialInputs) -> Any:
    colour: Any = Gf.Vec3f(*MATERIAL_COLOURS[name])
    if look.texture:
        at = nodes.add(
            "atlas",
            "UsdPrimvarReader_float2",
            ("result", _TYPES.Float2),
            varname=(_TYPES.String, "atlas"),
        )
        colour = nodes.add(
            "colour",
            "UsdUVTexture",
            ("rgb", _TYPES.Float3),
            file=(_TYPES.Asset, look.texture),
            st=(_TYPES.Float2, at),
            sourceColorSpace=(_TYPES.Token, "sRGB"),
            wrapS=(_TYPES.Token, "clamp"),
            wrapT=(_TYPES.Token, "clamp"),
            fallback=(_TYPES.Float4, Gf.Vec4f(*MATERIAL_COLOURS[name], 1.0)),
        )
    elif look.coloured:
        colour = nodes.add(
            "displayColor",
            "UsdPrimvarReader_float3",
            ("result", _TYPES.Float3),
            varname=(_TYPES.String, "displayColor"),
            fallback=(_TYPES.Float3, colour),
        )
    return nodes.add(
        "surface",
        "UsdPreviewSurface",
        ("surface", _TYPES.Token),
        diffuseColor=(_TYPES.Color3f, colour),
        roughness=(_TYPES.Float, MATERIAL_ROUGHNESS[name]),
    )


def _geomprop(
    nodes: MaterialNodes, kind: str, type: Any, name: str, **default: tuple[Any, Any]
) -> Any:
    """Return the output of a primvar in MaterialX."""
    geomprop = (_TYPES.String, name)
    node = f"mtlx{name[0].upper()}{name[1:]}"
    id = f"ND_geompropvalue_{kind}"
    return nodes.add(node, id, ("out", type), geomprop=geomprop, **default)


def _mtlx_colour(nodes: MaterialNodes, name: str, look: MaterialInputs) -> Any:
    colour: Any = Gf.Vec3f(*MATERIAL_COLOURS[name])
    if look.texture:
        at = _geomprop(nodes, "vector2", _TYPES.Float2, "atlas")
        colour = nodes.add(
            "mtlxColour",
            "ND_image_color3",
            ("out", _TYPES.Color3f),
            file=(_TYPES.Asset, look.texture),
            default=(_TYPES.Color3f, colour),
            texcoord=(_TYPES.Float2, at),
        )
        file = UsdShade.Shader(colour.GetPrim()).GetInput("file")
        file.GetAttr().SetColorSpace("srgb_texture")
    elif look.coloured:
        default = {"default": (_TYPES.Color3f, colour)}
        colour = _geomprop(nodes, "color3", _TYPES.Color3f, "displayColor", **default)
    return colour


def _standard_surface(nodes: MaterialNodes, name: str, look: MaterialInputs) -> Any:
    """Return the standard_surface of a material, with transmitted light and film."""
    colour = _mtlx_colour(nodes, name, look)
    inputs: dict[str, tuple[Any, Any]] = {
        "base_color": (_TYPES.Color3f, colour),
        "specular_roughness": (_TYPES.Float, MATERIAL_ROUGHNESS[name]),
    }
    if name != "rachis":
        inputs |= {
            "subsurface": (_TYPES.Float, _THROUGH),
            "subsurface_color": (_TYPES.Color3f, colour),
            "thin_walled": (_TYPES.Bool, True),
        }
    if look.film:
        film = _geomprop(nodes, "float", _TYPES.Float, "filmThickness")
        for key, ends in {
            "specular_IOR": (_BELOW_FILM, _PLAIN),
            "specular_roughness": (_FILM_ROUGHNESS, MATERIAL_ROUGHNESS[name]),
        }.items():
            values = dict(zip(("in1", "in2"), ((_TYPES.Float, end) for end in ends), strict=True))
            chosen = nodes.add(
                f"mtlx_{key}",
                "ND_ifgreater_float",
                ("out", _TYPES.Float),
                value1=(_TYPES.Float, film),
                value2=(_TYPES.Float, 0.0),
                **values,
            )
            inputs[key] = (_TYPES.Float, chosen)
        inputs["thin_film_thickness"] = (_TYPES.Float, film)
    return nodes.add(
        "standard", "ND_standard_surface_surfaceshader", ("out", _TYPES.Token), **inputs
    )


def _hair(nodes: MaterialNodes, name: str, look: MaterialInputs) -> Any:
    """Return the hair shader of barbs, which absorbs what their colour lacks."""
    around = (_TYPES.Float, _AROUND_HAIR)
    absorption = nodes.add(
        "mtlxAbsorption",
        "ND_chiang_hair_absorption_from_color",
        ("absorption", _TYPES.Float3),
        color=(_TYPES.Color3f, _mtlx_colour(nodes, name, look)),
        azimuthal_roughness=around,
    )
    lobes = ("roughness_R", "roughness_TT", "roughness_TRT")
    rough = nodes.add(
        "mtlxRoughness",
        "ND_chiang_hair_roughness",
        (lobes[0], _TYPES.Float2),
        longitudinal=(_TYPES.Float, _ALONG_HAIR),
        azimuthal=around,
    )
    shader = UsdShade.Shader(rough.GetPrim())
    hair = nodes.add(
        "mtlxHair",
        "ND_chiang_hair_bsdf",
        ("out", _TYPES.Token),
        ior=(_TYPES.Float, _KERATIN),
        cuticle_angle=(_TYPES.Float, _NO_SCALES),
        absorption_coefficient=(_TYPES.Float3, absorption),
        **{each: (_TYPES.Float2, shader.CreateOutput(each, _TYPES.Float2)) for each in lobes},
    )
    surface = {"bsdf": (_TYPES.Token, hair)}
    return nodes.add("mtlxSurface", "ND_surface", ("out", _TYPES.Token), **surface)


# the last one is chosen at first
_BARB_SHADERS = {"surface": _standard_surface, "hair": _hair}
