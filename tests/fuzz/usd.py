"""Damaged USD stages: edits of their text, of their values, and of the bytes of crate files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from feathers import entries, frame
from pxr import Gf, Sdf, UsdGeom, Vt
from usdin_scenes import (
    TYPES,
    add_curves,
    add_mesh,
    add_skinned,
    arc,
    lifted,
    new_stage,
    sheet,
    vec,
)

from featherfx.usd.write.cache_writer import CacheWriter

from .cases import Command, Kind
from .usd_values import edit_value

Random = np.random.Generator
BODY = Path(__file__).resolve().parents[2] / "samples" / "pigeon" / "body.usdc"

SKIN_GROOM = """name = "patch"
[skin]
usd = "{file}"
prim = "{prim}"
[[region]]
id = "coat"
kind = "covert"
count = 3
length = 0.02
where = [{{ primvar = "{primvar}" }}]
flow = {{ direction = [-1, 0.2, 0] }}
"""
SCENE_SHOT = """name = "shot"
groom = "{groom}.toml"
frames = [1, 3]
quality = "draft"
[skin]
usd = "{file}"
prim = "{prim}"
tolerance = 10
"""
MORE = """[[collider]]
usd = "scene.usda"
prims = ["/wall", "/bird/skin"]
[wind_usd]
usd = "scene.usda"
prim = "/air"
[level_of_detail]
usd = "scene.usda"
prim = "/camera"
"""


def prepare(folder: Path) -> None:
    """A scene with a skin, walls, wind and a camera; a drawn groom; a cache; a sample's body."""
    _write_scene(folder)
    _write_groom(folder)
    with CacheWriter(
        folder / "cache.usda", entries(), (1, 3), 24.0, metadata={"shot": "s"}
    ) as cache:
        for number in range(1, 4):
            cache.write(frame(number))
    Sdf.Layer.OpenAsAnonymous(str(BODY)).Export(str(folder / "body.usda"))
    bodies = {
        "scene": ("scene.usda", "/bird/skin", "mask"),
        "body": ("body.usda", "/pigeon/body", "torso"),
    }
    for name, (file, prim, primvar) in bodies.items():
        groom = SKIN_GROOM.format(file=file, prim=prim, primvar=primvar)
        (folder / f"{name}_groom.toml").write_text(groom)
        shot = SCENE_SHOT.format(file=file, prim=prim, groom=f"{name}_groom")
        (folder / f"{name}.toml").write_text(shot + (MORE if name == "scene" else ""))


def _write_scene(folder: Path) -> None:
    stage = new_stage(folder / "scene.usda")
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    mesh = add_skinned(stage)
    api = UsdGeom.PrimvarsAPI(mesh)
    points, counts, quads = sheet()
    api.CreatePrimvar("mask", TYPES.FloatArray, "vertex").Set([1.0] * len(points))
    api.CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set(
        Vt.Vec2fArray.FromNumpy(points[:, :2].astype(np.float32))
    )
    wall = add_mesh(stage, "/wall", lifted(points, -1.0), counts, quads)
    for code in (1, 2, 3):
        wall.GetPointsAttr().Set(vec(lifted(points, -1.0 + 0.01 * code)), code)
    wall.CreateHoleIndicesAttr([1, 2])
    UsdGeom.Xformable(wall).AddTranslateOp().Set(Gf.Vec3d(0, 0, -0.1), 1)
    UsdGeom.Subset.CreateGeomSubset(wall, "part", "face", Vt.IntArray([0, 1]), "f")
    air = UsdGeom.Points.Define(stage, "/air")
    for code in (1, 3):
        air.CreatePointsAttr().Set(vec(points), code)
        air.CreateVelocitiesAttr().Set(vec(points * code), code)
    camera = UsdGeom.Camera.Define(stage, "/camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    camera.CreateFocalLengthAttr(30.0)
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(15.0)
    stage.Save()


def _write_groom(folder: Path) -> None:
    stage = new_stage(folder / "groom.usda")
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/bird").GetPrim())
    two = [arc(), arc() + np.array([0, 1, 0])]
    add_curves(stage, "/bird/wing", two, ids=["a", "b"], region=(TYPES.StringArray, ["x", "y"]))
    cubic = add_curves(
        stage, "/bird/cubic", [arc(points=7)], ids=["c"], scale=(TYPES.FloatArray, [1.1])
    )
    cubic.CreateTypeAttr("cubic")
    cubic.CreateBasisAttr("catmullRom")
    cubic.CreateWrapAttr("pinned")
    add_curves(stage, "/bird/templates/covert", [arc(0.1)], ids=["t"])
    instancer = UsdGeom.PointInstancer.Define(stage, "/bird/many")
    instancer.CreatePrototypesRel().SetTargets(["/bird/templates/covert"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(0, 2, 0), (0, 3, 0)])
    instancer.CreateOrientationsAttr(Vt.QuathArray([Gf.Quath(1), Gf.Quath(1)]))
    instancer.CreateScalesAttr([(1, 1, 1), (1, 1, 1)])
    instancer.CreateIdsAttr(Vt.Int64Array([7, 9]))
    ids = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar("featherId", TYPES.StringArray, "uniform")
    ids.Set(["m", "n"])
    barbed = add_curves(stage, "/bird/barbed", [arc(points=4)], ids=["d"])
    shaft = arc(points=4)
    for name, side in (("P_barbl", 1), ("P_barbr", -1)):
        grid = np.stack([shaft + np.array([k, k * side, 0]) / 100 for k in (1, 2)], axis=1)
        primvar = UsdGeom.PrimvarsAPI(barbed).CreatePrimvar(name, TYPES.Point3fArray, "vertex", 2)
        primvar.Set(vec(grid.reshape(-1, 3)))
    stage.Save()


COMMANDS = {
    "scene.usda": (Command(("check", "scene.usda")), Command(("check", "scene.toml"))),
    "groom.usda": (
        Command(("check", "groom.usda")),
        Command(("groom", "groom.usda", "-o", "out.usda", "--quality", "draft"), ("out.usda",)),
    ),
    "cache.usda": (
        Command(("check", "cache.usda")),
        Command(
            ("export", "cache.usda", "-o", "out.ply"),
            ("out.0001.ply", "out.0002.ply", "out.0003.ply", "out.ply"),
        ),
        Command(("export", "cache.usda", "-o", "flat.usda"), ("flat.usda",)),
        Command(("retime", "cache.usda", "-o", "slow.usda", "--speed", "0.5"), ("slow.usda",)),
        Command(("view", "cache.usda", "--html", "page.html"), ("page.html",)),
        Command(("export", "cache.usda", "-o", "drawn.usda", "--condensed"), ("drawn.usda",)),
        Command(
            ("preview", "cache.usda", "-o", "cache.png", "--frame", "2", "--size", "40x30"),
            ("cache.png",),
        ),
    ),
    "body.usda": (Command(("check", "body.usda")), Command(("check", "body.toml"))),
}


def damage(random: Random, number: int, folder: Path) -> tuple[str, Sequence[Command]]:
    """One stage of the folder with one to three faults; the bytes of every fourth as a crate."""
    name = list(COMMANDS)[(0, 1, 2, 0, 1, 2, 3)[number % 7]]
    file = folder / name
    how = ("text", "values", "text", "values", "crate")[number // 7 % 5]
    times = int(random.integers(1, 4))
    if how == "text":
        # its arrays are long; text around them is what is damaged
        text = file.read_bytes()
        done = []
        for _ in range(times):
            edit = TEXT_EDITS[random.integers(len(TEXT_EDITS))]
            text = edit(random, text)
            done.append(edit.__name__)
        file.write_bytes(text)
        return f"{name}: {', '.join(done)}", COMMANDS[name]
    layer = Sdf.Layer.OpenAsAnonymous(str(file))
    if how == "values":
        done = [edit_value(random, layer) for _ in range(times)]
        layer.Export(str(file))
        return f"{name}: {', '.join(done)}", COMMANDS[name]
    # a crate is known by its bytes only under .usd and .usdc
    content = f"{file.stem}.usdc"
    layer.Export(str(folder / content))
    (folder / content).write_bytes(_flipped(random, (folder / content).read_bytes()))
    file.unlink()
    commands = [
        Command(tuple(each.replace(name, content) for each in command.arguments), command.outputs)
        for command in COMMANDS[name]
    ]
    for each in folder.glob("*.toml"):
        each.write_text(each.read_text().replace(name, content))
    return f"{content}: bytes", commands


def _flipped(random: Random, content: bytes) -> bytes:
    """Some bytes changed beyond the header, half of the time in the tables at the end."""
    found = bytearray(content)
    low = 88 if random.random() < 0.5 else max(88, len(found) - 2000)
    for place in random.integers(low, len(found), random.integers(1, 6)):
        found[place] = random.integers(256)
    return bytes(found)


ODD_NUMBERS = (
    "nan", "inf", "-inf", "-1", "0", "1e300", "-1e300", "1e-300", "2147483647",
    "99999999999999999999", "1e99999", "None", '"x"', "()", "[]", "{}", "[1, 2]",
    "(1, 2)", "(nan, 0, 0)",
)  # fmt: skip
LITERALS = {
    "string": '"x"', "string[]": '["x", "y"]', "token": '"x"', "token[]": '["x"]', "bool": "1",
    "int": "3", "int[]": "[1, -1]", "int64[]": "[1, 99999999999]", "uchar[]": "[1, 2]",
    "uint[]": "[4000000000]", "float": "1.5", "float[]": "[nan, 1]", "double[]": "[1e300, 2]",
    "half[]": "[1, 2]", "half3[]": "[(1, 2, 3)]", "float2[]": "[(1, 2)]", "point3f": "(1, 2, 3)",
    "point3f[]": "[(1, 2, nan)]", "double3[]": "[(1e300, 2, 3)]", "color4f[]": "[(1, 2, 3, 4)]",
    "quatf[]": "[(1, 0, 0, 0)]", "quath": "(0, 0, 0, 0)", "int3[]": "[(1, 2, 3)]",
    "matrix4d": "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))",
    "matrix2d[]": "[((1, 0), (0, 1))]", "asset": "@a b<>@", "asset[]": "[@@, @x.usd@]",
    "timecode": "1", "foo": "1", "foo[]": "[1, 2]", "dictionary": "{ int a = 1 }", "rel": "</bird>",
    "point3d[]": "[]", "opaque": "None", "timecode[]": "[nan]",
}  # fmt: skip
METADATA = (
    'upAxis = "X"', 'upAxis = "y"', "upAxis = 3", 'upAxis = ""', "metersPerUnit = 1e300",
    "metersPerUnit = 0", "metersPerUnit = -1", "metersPerUnit = nan", "metersPerUnit = inf",
    'metersPerUnit = "a"', "metersPerUnit = 1e-300", "timeCodesPerSecond = 0",
    "timeCodesPerSecond = -24", "timeCodesPerSecond = nan", "timeCodesPerSecond = 1e300",
    "framesPerSecond = 0", "framesPerSecond = nan", "startTimeCode = nan", "endTimeCode = inf",
    "endTimeCode = 1e12", "startTimeCode = -1e300", "endTimeCode = -5", 'defaultPrim = "none"',
    'defaultPrim = "a b"', "defaultPrim = 3", "subLayers = [@{name}@]", "subLayers = [@none.usda@]",
    "subLayers = [@@]", "subLayers = [@a<>|?*b@]", "subLayers = [@.@]", "subLayers = [@/dev/null@]",
    "customLayerData = { int featherfx = 3 }",
    'customLayerData = { dictionary featherfx = { string layout = "clips" } }',
)  # fmt: skip
ARCS = (
    "prepend references = </bird>", "prepend payload = </bird>", "prepend references = </none>",
    "prepend references = @@", "prepend references = @@</x>", "prepend payload = @none.usda@",
    "prepend references = @{name}@", "prepend references = @{name}@</bird>", "references = None",
    "prepend payload = @a<>|?*b@", "prepend references = @.@", "prepend inherits = </none>",
    "prepend inherits = </bird>", "prepend specializes = </wall>", "active = false",
    "instanceable = true", 'kind = "x"', 'prepend apiSchemas = ["SkelBindingAPI", "None"]',
    "prepend references = @\x01@", "prepend payload = [</bird>, </none>]", "clips = {}",
    'clips = { dictionary default = { asset[] assetPaths = [@none.usd@] string primPath = "/" } }',
    "clips = { dictionary default = { int assetPaths = 3 } }", "hidden = 3",
    'variants = { string a = "b" }',
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")
_VALUE = re.compile(
    rb"^(\s*)((?:custom |uniform |varying )*)([\w]+(?:\[\])?) ([\w:]+) = (.+)$", re.M
)
_DEF = re.compile(rb'^\s*(?:def|over|class)(?: \w+)? "\w+"', re.M)


def _pick(random: Random, found: Sequence[re.Match[bytes]]) -> re.Match[bytes] | None:
    return found[random.integers(len(found))] if len(found) else None


def _put(text: bytes, match: re.Match[bytes] | None, other: bytes) -> bytes:
    return text if match is None else text[: match.start()] + other + text[match.end() :]


def odd_number(random: Random, text: bytes) -> bytes:
    """A number of a random line, so that long arrays do not take all the blame."""
    lines = text.split(b"\n")
    for _ in range(20):
        at = int(random.integers(1, len(lines)))
        numbers = list(_NUMBER.finditer(lines[at]))
        if numbers:
            odd = ODD_NUMBERS[random.integers(len(ODD_NUMBERS))].encode()
            lines[at] = _put(lines[at], _pick(random, numbers), odd)
            break
    return b"\n".join(lines)


def odd_type(random: Random, text: bytes) -> bytes:
    """An attribute of another type, with a value that fits it."""
    match = _pick(random, list(_VALUE.finditer(text)))
    if match is None:
        return text
    kind = list(LITERALS)[random.integers(len(LITERALS))]
    line = match[1] + match[2] + f"{kind} {match[4].decode()} = {LITERALS[kind]}".encode()
    return _put(text, match, line + (b" (" if match[5].endswith(b"(") else b""))


def lost_lines(random: Random, text: bytes) -> bytes:
    lines = text.split(b"\n")
    at = int(random.integers(1, len(lines)))
    del lines[at : at + int(random.integers(1, 3))]
    return b"\n".join(lines)


def double_line(random: Random, text: bytes) -> bytes:
    lines = text.split(b"\n")
    at = int(random.integers(1, len(lines)))
    return b"\n".join([*lines[:at], lines[at], *lines[at:]])


def cut_short(random: Random, text: bytes) -> bytes:
    return text[: random.integers(len(text))] if random.random() < 0.2 else text


def odd_bytes(random: Random, text: bytes) -> bytes:
    """Bytes that are no UTF-8 within a text in quotes, or anywhere."""
    found = list(re.finditer(rb'(?<=")\w+(?=")', text))
    if random.random() < 0.8 and found:
        return _put(
            text, _pick(random, found), (b"a\xff\xfe", b"\xc3(", b"a\x00b")[random.integers(3)]
        )
    at = int(random.integers(len(text)))
    return text[:at] + bytes(random.integers(0, 256, 2).tolist()) + text[at:]


def odd_metadata(random: Random, text: bytes) -> bytes:
    """A line of the stage's metadata over the one of its name, if there is one."""
    name = re.search(rb'defaultPrim = "(\w+)"', text)
    line = (
        METADATA[random.integers(len(METADATA))].replace("{name}", _own_name(text, name)).encode()
    )
    head, mark, rest = text.partition(b"\n)\n")
    if not mark:
        return text
    key = line.split(b" ")[0]
    kept = [each for each in head.split(b"\n") if not each.strip().startswith(key + b" =")]
    return b"\n".join([*kept, b"    " + line]) + mark + rest


def _own_name(text: bytes, name: re.Match[bytes] | None) -> str:
    if b"/camera" in text or b'"camera"' in text:
        return "scene.usda"
    return "groom.usda" if name and name[1] == b"bird" else "cache.usda"


def odd_arc(random: Random, text: bytes) -> bytes:
    match = _pick(random, list(_DEF.finditer(text)))
    if match is None:
        return text
    arc_of = ARCS[random.integers(len(ARCS))].replace("{name}", _own_name(text, None))
    rest = text[match.end() :]
    opened = re.match(rb"\s*\(", rest)
    if opened:
        return text[: match.end()] + b" (\n" + arc_of.encode() + b"\n" + rest[opened.end() :]
    return text[: match.end()] + b" (\n" + arc_of.encode() + b"\n)" + rest


TEXT_EDITS = (
    odd_number, odd_number, odd_type, odd_type, odd_type, lost_lines, double_line, cut_short,
    odd_bytes, odd_metadata, odd_metadata, odd_arc, odd_arc,
)  # fmt: skip

# imported before the processes part, which would be most of the time of a case
KIND = Kind(
    prepare,
    damage,
    (
        "featherfx.baking.pipeline",
        "featherfx.feather.leaves",
        "featherfx.groom.read.read",
        "featherfx.shot.motion.motion",
        "featherfx.shot.read.read",
        "featherfx.usd.check.check",
        "featherfx.usd.convert.condensed",
        "featherfx.usd.convert.mesh_files",
        "featherfx.usd.convert.retime",
        "featherfx.view.page",
        "featherfx.usd.read.groom",
        "featherfx.usd.read.scenes",
        "featherfx.usd.read.skin",
        "featherfx.usd.write.forms",
    ),
)
