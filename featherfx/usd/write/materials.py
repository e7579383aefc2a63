"""Materials of a cache: UsdPreviewSurface, and MaterialX beside it.

Vanes and rachises are standard_surface. Barbs, as curves, have the variants "hair" (Chiang et al.
2016, doi:10.1111/cgf.12830) and "surface" of USD's variant set of materials. Colours are those of
the textures, else of displayColor, else of keratin. UsdPreviewSurface and hair have no film.

A USD that was built without MaterialX does not know its nodes, and its validators report them.

Textures: images of the colours.

A chart holds both vanes of one feather by its texture coordinates: the trailing one left of its
middle, the leading one right of it, the root below. Every feather has its own, whatever it shares
with others, so that it can be painted over. The border of a chart repeats its edge. Charts stand in
square tiles, UDIM where there are several.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, UsdGeom, UsdShade

from featherfx.algebra.types import Array, Indices
from featherfx.errors import Problem
from featherfx.files.atomic_write import Store
from featherfx.groom.materials import RACHIS_COLOUR, VANE_COLOUR, displayed
from featherfx.usd.types import FeatherEntry, OutputError

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


_MAX_TILE_SIDE = 4096  # pixels of a tile
_BORDER = 2
_TILES_ACROSS, _FIRST_TILE = (
    10,
    1001,
)  # tiles of a row, and the number of the first, as UDIM has them
_SIGNED = "featherfx"
_MAX_CHARTS = 64  # charts in memory that other feathers may have as well


@dataclass(frozen=True)
class Atlas:
    """Places of the charts. feathers: their number.

    pixels: of a chart along the feather; it is half as wide.
    """

    feathers: int
    pixels: int

    @property
    def side(self) -> int:
        """Return the pixels of a tile's side, a power of two."""
        side = 1 << (self.pixels - 1).bit_length()
        while side < _MAX_TILE_SIDE and np.prod(self._grid(side)) < self.feathers:
            side *= 2
        return side

    def _grid(self, side: int) -> tuple[int, int]:
        """Return charts across a tile, and up."""
        return side // (self.pixels // 2), side // self.pixels

    def _places(self) -> tuple[Indices, ...]:
        """Return (N,) tile, column and row of each feather."""
        across, up = self._grid(self.side)
        tile, place = np.divmod(np.arange(self.feathers), across * up)
        return tile, *np.divmod(place, across)[::-1]

    @property
    def charts(self) -> Array:
        """Return (N, 4) u, v of each chart's corner, and its size du, dv.

        Texture coordinates s, t of a feather are at u + s du, v + t dv.
        """
        tile, column, row = self._places()
        size = np.array([self.pixels // 2, self.pixels])
        corner = np.stack([column, row], axis=1) * size + _BORDER
        begin = corner / self.side + np.stack([tile % _TILES_ACROSS, tile // _TILES_ACROSS], axis=1)
        return np.hstack([begin, np.broadcast_to((size - 2 * _BORDER) / self.side, begin.shape)])

    def given_to(self, entries: Sequence[FeatherEntry]) -> tuple[FeatherEntry, ...]:
        """Return each entry with its chart."""
        charts = zip(entries, self.charts, strict=True)
        return tuple(replace(entry, chart=chart) for entry, chart in charts)

    def files(self, path: Path) -> list[Path]:
        """Return the images of a cache, in the order of their tiles."""
        last = int(self._places()[0][-1])
        return [
            path.with_name(f"{path.stem}.colour.{_FIRST_TILE + k}.png") for k in range(last + 1)
        ]

    def asset(self, path: Path) -> str:
        """Return the asset path of the images in the cache."""
        name = "<UDIM>" if len(self.files(path)) > 1 else _FIRST_TILE
        return f"./{path.stem}.colour.{name}.png"

    def stored(self, path: Path, entries: Sequence[FeatherEntry]) -> Iterator[tuple[Path, Store]]:
        """Yield the images with the function that writes each, as write_all takes them."""
        for file, image in zip(self.files(path), self._images(entries), strict=True):
            yield file, partial(_save, image)

    def _images(self, entries: Sequence[FeatherEntry]) -> Iterator[NDArray[np.uint8]]:
        tiles, columns, rows = self._places()
        width, height, side = self.pixels // 2, self.pixels, self.side
        known: dict[Any, Array] = {}
        for tile in range(int(tiles[-1]) + 1):
            image = np.empty((side, side, 3), np.uint8)
            image[...] = np.round(255.0 * displayed(np.array(VANE_COLOUR)))
            for k in np.flatnonzero(tiles == tile).tolist():
                left, low = columns[k] * width, side - (rows[k] + 1) * height
                shades = np.round(255.0 * displayed(self._chart(entries[k], known)))
                image[low : low + height, left : left + width] = shades[::-1]
            yield image

    def _chart(self, entry: FeatherEntry, known: dict[Any, Array]) -> Array:
        """Return (H, W, 3) linear colours of a feather, the root first."""
        from featherfx.feather.colours import brightness, charted

        if entry.shape is None:
            return np.array(VANE_COLOUR)[None, None]
        kind, mirrored, _ = entry.shape
        if (id(kind), mirrored) not in known:
            if len(known) >= _MAX_CHARTS:
                known.clear()
            sizes = self.pixels // 2, self.pixels
            ways = [
                np.clip((np.arange(n) + 0.5 - _BORDER) / (n - 2 * _BORDER), 0.0, 1.0) for n in sizes
            ]
            known[id(kind), mirrored] = charted(kind, entry.feather, *ways)
        return brightness(kind.colour, entry.id) * known[id(kind), mirrored]


def refuse_textures(files: Sequence[Path], overwrite: bool) -> None:
    """Raise OutputError where images cannot be written, or were painted over."""
    problems = []
    if importlib.util.find_spec("PIL") is None:
        told = 'Pillow is not installed. Run pip install "featherfx[preview]"'
        problems.append(Problem("bake", "textures", told))
    elif not overwrite:
        told = "is not as featherfx wrote it. Move it elsewhere, or --overwrite"
        problems = [Problem(str(f), "", told) for f in files if f.exists() and not _is_unchanged(f)]
    if problems:
        raise OutputError(*problems)


def _is_unchanged(file: Path) -> bool:
    """Return whether an image has the colours that it was written with."""
    from PIL import Image

    try:
        with Image.open(file) as image:
            text = getattr(image, "text", {}).get(_SIGNED)
            return bool(text == _signature(np.asarray(image)))
    except (OSError, ValueError, SyntaxError):
        return False


def _signature(image: NDArray[np.uint8]) -> str:
    return hashlib.blake2b(np.ascontiguousarray(image).tobytes(), digest_size=16).hexdigest()


def _save(image: NDArray[np.uint8], path: Path) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    told = PngInfo()
    told.add_text(_SIGNED, _signature(image))
    Image.fromarray(image).save(path, pnginfo=told)
