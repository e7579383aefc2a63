"""Materials "vane" and "rachis": UsdPreviewSurface, and standard_surface of MaterialX.

They stand until look development binds others. Colours are those of the textures where there are
any, else of displayColor, else of keratin. What shines by interference has the primvar
filmThickness, which the shader of MaterialX takes; UsdPreviewSurface has no place for it. MaterialX
is there with textures or a film only: a USD that was built without it does not know its nodes, and
its validators say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from pxr import Gf, Sdf, UsdGeom, UsdShade

from featherfx.feather import colours
from featherfx.usd.types import FeatherEntry

COLOURS = {"vane": colours.VANE, "rachis": colours.SHAFT}
_ROUGHNESS = {"vane": 0.65, "rachis": 0.4}
# of the vanes' light, what goes through: as in pictures (featherfx/render/light_kernels.py)
_THROUGH = 0.34
# where there is a film: index of what is below it (that of the film is the shader's default), and
# roughness; chosen by eye
_BELOW_FILM, _PLAIN, _FILM_ROUGHNESS = 2.0, 1.5, 0.3
_TYPES = Sdf.ValueTypeNames


class Look(NamedTuple):
    """What materials take. coloured: whether displayColor. film: whether filmThickness. texture:
    name of the pictures, whose coordinates are the primvar atlas; empty: none."""

    coloured: bool = False
    film: bool = False
    texture: str = ""


def look_of(entries: Sequence[FeatherEntry], texture: str = "") -> Look:
    """What materials take of feathers."""
    found = [entry.colours for entry in entries if entry.colours is not None]
    coloured = len(found) == len(entries)
    return Look(coloured, coloured and found[0].film is not None, texture)


def define_materials(stage: Any, scope: Any, look: Look) -> dict[str, Any]:
    """Both materials under the path scope, by name."""
    UsdGeom.Scope.Define(stage, scope)
    made = {}
    for name in COLOURS:
        material = UsdShade.Material.Define(stage, scope.AppendChild(name))
        # shafts are outside of the charts
        own = look if name == "vane" else look._replace(texture="", film=False)
        nodes = _Nodes(stage, material.GetPath())
        material.CreateSurfaceOutput().ConnectToSource(_preview(nodes, name, own))
        if look.texture or look.film:
            material.CreateSurfaceOutput("mtlx").ConnectToSource(_standard(nodes, name, own))
        made[name] = material
    return made


class _Nodes:
    """The shaders of a material."""

    def __init__(self, stage: Any, path: Any) -> None:
        self._stage, self._path = stage, path

    def add(self, name: str, id: str, output: tuple[str, Any], **inputs: tuple[Any, Any]) -> Any:
        """A shader's output. inputs: type, and value or another's output."""
        shader = UsdShade.Shader.Define(self._stage, self._path.AppendChild(name))
        shader.CreateIdAttr(id)
        for each, (kind, value) in inputs.items():
            put = shader.CreateInput(each, kind)
            if isinstance(value, UsdShade.Output):
                put.ConnectToSource(value)
            else:
                put.Set(value)
        return shader.CreateOutput(*output)


def _preview(nodes: _Nodes, name: str, look: Look) -> Any:
    colour: Any = Gf.Vec3f(*COLOURS[name])
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
            fallback=(_TYPES.Float4, Gf.Vec4f(*COLOURS[name], 1.0)),
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
        roughness=(_TYPES.Float, _ROUGHNESS[name]),
    )


def _standard(nodes: _Nodes, name: str, look: Look) -> Any:
    """The same by nodes of MaterialX, with light that goes through, and the film."""

    def primvar(node: str, kind: str, type: Any, of: str, **default: tuple[Any, Any]) -> Any:
        geomprop = (_TYPES.String, of)
        return nodes.add(
            node, f"ND_geompropvalue_{kind}", ("out", type), geomprop=geomprop, **default
        )

    colour: Any = Gf.Vec3f(*COLOURS[name])
    if look.texture:
        at = primvar("mtlxAtlas", "vector2", _TYPES.Float2, "atlas")
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
        colour = primvar("mtlxDisplayColor", "color3", _TYPES.Color3f, "displayColor", **default)
    inputs: dict[str, tuple[Any, Any]] = {
        "base_color": (_TYPES.Color3f, colour),
        "specular_roughness": (_TYPES.Float, _ROUGHNESS[name]),
    }
    if name == "vane":
        inputs |= {
            "subsurface": (_TYPES.Float, _THROUGH),
            "subsurface_color": (_TYPES.Color3f, colour),
            "thin_walled": (_TYPES.Bool, True),
        }
    if look.film:
        film = primvar("mtlxFilm", "float", _TYPES.Float, "filmThickness")
        for key, ends in {
            "specular_IOR": (_BELOW_FILM, _PLAIN),
            "specular_roughness": (_FILM_ROUGHNESS, _ROUGHNESS[name]),
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
