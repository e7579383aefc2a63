"""Damaged grooms, shots, presets and tables: edits of their lines, values and bytes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from .cases import Command, Kind

Random = np.random.Generator

GROOM = """name = "wing"
[[joint]]
name = "left_shoulder"
position = [0.0, 0.1, 0.0]
role = "shoulder"
side = "left"
mirror = "y"
[[joint]]
name = "left_elbow"
position = [0.0, 0.3, 0.0]
parent = "left_shoulder"
role = "elbow"
side = "left"
mirror = "y"
[[feather]]
id = "tail"
kind = "tail_feather"
position = [0, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
scale = 0.5
overrides = { rachis.camber = 5, leading.outline = [[0, 0], [0.5, 0.1], [1, 0]] }
[[feather]]
id = "crest"
kind = "own"
position = [0.1, 0, 0]
rotation = [0, 10, 0]
[[row]]
id = "left_primary"
kind = ["swan_primary", "swan_secondary"]
blend = true
count = 4
first = { position = [0, 0.1, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
last = { position = [0, 0.4, 0], direction = [0, 1, 0], up = [0, 0, 1] }
path = [[0, 0.1, 0], [0, 0.2, 0.05], [0, 0.4, 0]]
scale = [1.0, 0.6]
lift = 0.002
spacing = 0.8
joint = "left_elbow"
side = "left"
mirror = "y"
[[table]]
file = "a.csv"
region = "back"
[[table]]
file = "b.npz"
kind = "covert"
scale = 0.5
[[wing]]
id = "right_wing"
shoulder = [0.03, -0.3, 0.03]
fold = 0.5
mirror = "y"
[wing.type]
base = "sparrow"
primaries.count = 3
secondaries.count = 3
tertials.count = 2
coverts = []
[[tail]]
id = "fan"
position = [-0.5, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
count = 4
lengths = [0.05]
root_width = 0.02
angles = [9, 90]
[variation]
seed = 3
angle = 2
modulus_across_barbs = 0.1
thickness = 0.1
length = 0.1
width = 0.05
variants = 4
[overrides]
"left_*" = { rachis.camber = 9, width = 1.1 }
tail = { scale = 1.2 }
"""
# a plate of two faces, y up, in centimetres
SKIN = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Mesh "plate"
{
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 3, 4, 1, 1, 4, 5, 2]
    point3f[] points = [(0, 0, 0), (0, 0, 20), (0, 5, 40), (30, 0, 0), (30, 0, 20), (30, 5, 40)]
    float[] primvars:edge = [1, 1, 1, 0, 0, 0] (interpolation = "vertex")
    uniform token subdivisionScheme = "none"
}
"""
GROWN = """name = "grown"
[skin]
usd = "skin.usda"
prim = "/plate"
[space]
of = "skin"
left = "-z"
[layout]
thickness = 0.1
gap = 0.002
[[joint]]
name = "shoulder"
position = { vertex = 1, offset = [0, 0, 2] }
[[feather]]
id = "one"
kind = "covert"
position = { primvar = "edge" }
direction = [-1, 0.1, 0]
up = [0, 1, 0]
[[row]]
id = "right_quills"
kind = "swan_secondary"
count = 3
first = { position = { vertex = 0 }, direction = [-1, 0.1, 0], up = [0, 1, 0] }
last = { position = { vertex = 2 }, direction = [-1, 0.1, 0.5], up = [0, 1, 0] }
path = [{ vertex = 0, offset = [0, 0.3, 1] }, { vertex = 1 }, { vertex = 2 }]
scale = [0.5, 0.4]
mirror = "z"
[[region]]
id = "coat"
kind = "body_contour"
count = 8
length = 0.03
max_length_per_free_radius = 0.9
where = [
    { sphere = { centre = { vertex = 4 }, radius = 30 }, soft = 2 },
    { primvar = "edge" },
    { free_radius = 1.0 },
    { x = [0, 30] },
]
flow = { away = { vertex = 4 }, turn = 10 }
variation = { length = 0.08, curl = 3 }
"""
GROWN_SHOT = """name = "grown"
groom = "grown.toml"
frames = [1, 3]
quality = "draft"
[skin]
usd = "skin.usda"
prim = "/plate"
tolerance = 10
[[detail]]
region = "coat"
level = "guided"
every = 2
[contact]
regions = ["coat"]
"""
SHOT = """name = "shot"
groom = "groom.toml"
frames = [1, 4]
frames_per_second = 24
wind = { base = "gale", gust = 0.3 }
quality = "mine"
gravity = [0, 0, -9.81]
sleep = true
cycle = 0
[overrides]
"right_*" = { rachis.sweep = 2 }
[motion]
kind = "act"
amount = [[0, 0.5], [0.1, 1]]
[[motion.motions]]
kind = "keys"
keyframes = [
  { time = 0.0, joint = "left_elbow", rotation = [0, 0, 0] },
  { time = 1.0, joint = "left_elbow", rotation = [1, 0, 0, 0.1], position = [0, 0, 0.1] },
]
[[motion.motions]]
base = "glide"
start = -0.1
tempo = 2
[[motion.motions]]
kind = "level"
trunk_angle = 20
[[motion.motions]]
kind = "swing"
joints = "fan*"
axis = [0, 0, 1]
angle = 5
frequency = 2
[contact]
thickness = 0.001
friction = 0.3
steps = 4
[[grip]]
feather = "tail"
row = 1.0
column = 0.0
displacement = [0, 0, 0.01]
start = 0.0
end = 0.1
stiffness = 100
[[force]]
feather = "crest"
span = [0.2, 0.8]
force = [0, 0, 0.01]
keys = [[0.0, 0.0], [0.1, 1.0]]
[[detail]]
feathers = "right_*"
level = "coarse"
[[shelter]]
region = "back"
share = 0.5
[[channel]]
name = "ruffle"
feathers = "right_*"
keys = [[1, 0], [3, 20]]
soft = 0.01
[[target]]
feathers = "tail"
keys = [[1, 0], [2, 1], [4, 0]]
tolerance = 2
within = 0.001
"""
PRESETS = {
    "feather/own": 'base = "covert"\nlength = 0.03\nrachis.taper = 0.8\n'
    'vane_material = { base = "own_vane", thickness = 1e-4 }\n',
    "feather/swan_primary": 'base = "swan_primary"\ncalamus = 0.2\n',
    "material/vane/own_vane": 'base = "swan_vane"\n',
    "quality/mine": 'base = "draft"\nrows = 12\ncolumns = 3\ntolerance = 1e-3\n',
    "wind/gale": 'base = "breeze"\nspeed = 20\nseed = 2\ndirection = [1, 0.2, 0]\n',
}
HEAD = "id,kind,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z,scale,region,side\n"
ROWS = "".join(f"t{k},covert,{0.01 * k},0,0.1,-1,0,0.1,0,0,1,0.9,back,left\n" for k in range(12))

NUMBERS = (
    *("0", "-1", "1", "0.5", "-0.0", "1e308", "-1e308", "1e-308", "nan", "inf", "-inf", "1e30"),
    *("1000000000", "100000", "99999", "9223372036854775808", "1" + "0" * 40, "1" * 5000),
)
VALUES = (
    *("true", '""', '"x"', '"covert"', '"left_*"', "[]", "{}", "[[]]", "[{}]", "[1, 2, 3]", "'*'"),
    *("1979-05-27", "07:32:00", '"a\\nb"', '"\\u0000"', '"\\u001b[31m"', '"\\u2028"', '"é中"'),
    *('"' + "x" * 5000 + '"', "[" * 40 + "]" * 40, "[" * 3000, "{ a = " * 50 + "1" + " }" * 50),
    *('"[" ', '"[!a]*"', '"' + "*a" * 200 + '"', "{ base = 'x' }", "{ base = 1 }"),
    "[" + "1," * 5000 + "]",
    *('"pipe"', '"/dev/zero"', '"."', '"groom.toml"', '"shot.toml"', '"a.csv"', '"../none.toml"'),
    *('"own"', '"own_vane"', '"mine"', '"gale"', '"hold"', '"flap"', '"shake"', '"final"'),
)  # fmt: skip
CELLS = (
    "",
    "nan",
    "inf",
    "x",
    "1e400",
    "-1",
    "0",
    '"',
    '"a\nb"',
    "a" * 3000,
    "\x00",
    "é",
    "1,2",
    "t1",
)


def prepare(folder: Path) -> None:
    """A shot with its groom, tables and presets; each is sound."""
    (folder / "groom.toml").write_text(GROOM)
    (folder / "shot.toml").write_text(SHOT)
    (folder / "skin.usda").write_text(SKIN)
    (folder / "grown.toml").write_text(GROWN)
    (folder / "grown_shot.toml").write_text(GROWN_SHOT)
    for name, text in PRESETS.items():
        path = folder / "presets" / f"{name}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "a.csv").write_text(HEAD + ROWS)
    count = 5
    np.savez_compressed(
        folder / "b.npz",
        id=np.array([f"n{k}" for k in range(count)]),
        position=np.random.default_rng(0).normal(size=(count, 3)),
        direction=np.tile([1.0, 0, 0], (count, 1)),
        up=np.tile([0, 0, 1.0], (count, 1)),
    )


def damage(random: Random, number: int, folder: Path) -> tuple[str, Sequence[Command]]:
    """Damages one to three times one file, and checks it and what is made of it."""
    del number
    os.mkfifo(folder / "pipe")
    files = ["groom.toml", "shot.toml", "grown.toml"] * 4 + ["grown_shot.toml", "a.csv", "b.npz"]
    files += [f"presets/{name}.toml" for name in PRESETS]
    file = folder / files[random.integers(len(files))]
    told = []
    for _ in range(random.integers(1, 4)):
        edits = EDITS.get(file.suffix, ())
        edit = _bytes if random.random() < 0.1 or not edits else edits[random.integers(len(edits))]
        told.append(edit.__name__)
        edit(random, file)
    name = str(file.relative_to(folder))
    presets = ("--presets", "presets")
    groom, shot = "groom.toml", "shot.toml"
    if name.startswith("grown"):
        groom, shot = "grown.toml", "grown_shot.toml"
    checked = dict.fromkeys([name if name.endswith(".toml") else groom, shot])
    commands = [Command(("check", *checked, *presets))]
    # what takes its time where it is sound and large is left to the check
    if random.random() < 0.3 and "_number" not in told:
        plan = ("bake", shot, "-o", "out.usda", "--plan", "2", *presets)
        commands.append(Command(plan, ("out.plan.json", "out.openjd.json")))
        rest = ("groom", groom, "-o", "rest.usda", "--quality", "mine", *presets)
        commands.append(Command(rest, ("rest.usda",)))
    return f"{name}: {', '.join(told)}", commands


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _put(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", errors="replace")


def _replaced(random: Random, file: Path, pattern: str, texts: Sequence[str]) -> None:
    """One of what fits the pattern becomes one of the texts."""
    text = _text(file)
    hits = list(re.finditer(pattern, text))
    if hits:
        hit = hits[random.integers(len(hits))]
        _put(file, text[: hit.start()] + texts[random.integers(len(texts))] + text[hit.end() :])


def _number(random: Random, file: Path) -> None:
    _replaced(random, file, r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])", NUMBERS)


def _value(random: Random, file: Path) -> None:
    _replaced(
        random, file, r'(?<== )("[^"\n]*"|[^"\n{\[]+$|\[.*\]$|\{.*\}$)', VALUES + NUMBERS[:12]
    )


def _string(random: Random, file: Path) -> None:
    _replaced(random, file, r'"[^"\n]*"', VALUES)


def _key(random: Random, file: Path) -> None:
    names = (
        "x",
        "name",
        "base",
        "kind",
        "scal",
        '"a b"',
        '"a\\nb"',
        "a.b.c",
        "a" + ".a" * 90,
        '""',
    )
    _replaced(random, file, r"[\w.]+(?= = )", names)


def _table(random: Random, file: Path) -> None:
    names = (
        *("[x]", "[[x]]", "[[feather]]", "[feather]", "[[row]]", "[table]", "[motion]", "[a.b]"),
        *("[[skin]]", "[skin]", "[[region]]", "[layout]", "[usd]", "[quality]", "[", "[]"),
    )
    _replaced(random, file, r"(?m)^\[.*\]$", names)


def _lines(random: Random, file: Path) -> None:
    """A line is lost, repeated or moved."""
    lines = _text(file).splitlines(keepends=True)
    if not lines:
        return
    line = lines.pop(random.integers(len(lines)))
    for _ in range((0, 1, 2, 400)[random.integers(4)]):
        lines.insert(random.integers(len(lines) + 1), line)
    _put(file, "".join(lines))


def _many(random: Random, file: Path) -> None:
    """Many unknown keys, joints in a chain, or feathers of one name."""
    count = int(10 ** random.uniform(1, 4))
    parts = (
        lambda k: f"key{k} = {k}\n",
        lambda k: f'[[joint]]\nname = "j{k}"\nposition = [0, 0, 0]\nparent = "j{k - 1}"\n',
        lambda k: f'[[feather]]\nid = "tail"\nkind = "covert{k}"\nposition = [0, 0, {k}]\n',
        lambda k: f'[[row]]\nid = "r{k}"\n',
        lambda k: f'[[force]]\nfeather = "none{k}"\nspan = [0, 1]\nforce = [0, 0, 1]\nkeys = []\n',
        lambda k: f'[[detail]]\nfeathers = "none{k}*"\nlevel = "full"\n',
    )
    part = parts[random.integers(len(parts))]
    more = "".join(part(k) for k in range(count))
    _put(file, more + _text(file) if more.startswith("key") else _text(file) + more)


def _cells(random: Random, file: Path) -> None:
    lines = _text(file).splitlines()
    if not lines:
        return
    row = random.integers(len(lines))
    cells = lines[row].split(",")
    cells[random.integers(len(cells))] = CELLS[random.integers(len(CELLS))]
    lines[row] = ",".join(cells)
    _put(file, "\n".join(lines) + "\n")


def _rows(random: Random, file: Path) -> None:
    count = int(10 ** random.uniform(1, 4.3))
    row = ROWS.splitlines()[0]
    _put(file, _text(file) + "".join(f"m{k}{row}\n" for k in range(count)))


def _bytes(random: Random, file: Path) -> None:
    """Bytes are changed, lost or inserted, or the end is lost."""
    data = bytearray(file.read_bytes())
    place, size = (int(random.integers(most)) for most in (len(data) + 1, 16))
    match random.integers(4):
        case 0:
            data[place : place + size] = random.bytes(size)
        case 1:
            del data[place : place + size]
        case 2:
            data[place:place] = bytes([random.integers(256)]) * int(10 ** random.uniform(0, 5))
        case _:
            del data[place:]
    file.write_bytes(bytes(data))


Edit = Callable[[Random, Path], None]
EDITS: dict[str, tuple[Edit, ...]] = {
    ".toml": (_number, _number, _value, _value, _string, _key, _table, _lines, _many),
    ".csv": (_cells, _cells, _lines, _rows),
}
KIND = Kind(
    prepare,
    damage,
    (
        "featherfx.baking.pipeline",
        "featherfx.baking.plan",
        "featherfx.groom.read.read",
        "featherfx.shot.motion.motion",
        "featherfx.shot.read.read",
        "featherfx.usd.write.forms",
    ),
)
