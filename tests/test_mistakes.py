"""Mistakes that people make: each is told in lines that name the place and what to write.

Files are those of samples with one thing changed; no case simulates.
"""

import shutil
import warnings

import pytest
from commands import invoke
from places import SAMPLES

import featherfx as ffx
from featherfx.errors import InputError, InputWarning

GPA = "overrides = {{ {} = 6 }}\nwidth = 1.5"
FLAT = '[[channel]]\nname = "turn"\nkeys = [1, 0, 12, 35]\n[motion]'
RGB = "overrides = { colour.base = [200, 30, 30] }\nwidth = 1.5"
ROW = '[[row]]\nid = "right_secondary"'
ROWS = f'[overrides."right_secondary_0*"]\nwidth = 1.1\n{ROW.replace("row", "rows")}'
# file of swan_wing, what it says, what is written instead, and what is told of it
IN_FILES = [
    ("shot", "frames = [1, 24]", "frames = [24, 1]", ":4: frames: the last frame 1 comes before"),
    ("shot", "frames = [1, 24]", "frames = 24", ":4: frames: 24 is not an array. Give 2 integers"),
    ("shot", "frames = [1, 24]", 'frames = "1-24"', "'1-24' is not an array. Give 2 integers in ["),
    ("shot", "frames = [1, 24]", "frames = [1, 24", "Unclosed array. Close the bracket"),
    ("shot", "per_second = 24", "per_second = 0", "0 is out of range. Give 1 to 1000 1/s"),
    ("shot", '"calm"', '"breze"', ":6: wind: no wind preset 'breze', did you mean 'breeze'?"),
    ("shot", '"calm"', '"calm', "Illegal character '\\n'. Close the quotes"),
    ("shot", '"calm"', "{ base = 'gust', direction = 90 }", "90 is not an array. Give 3 numbers"),
    ("shot", '"calm"', "{ base = 'gust', direction = [0, 0, 0] }", "a direction cannot be zero"),
    ("shot", '"calm"', '"calm"\ngravity = -9.81', "gravity: -9.81 is not an array. Give 3 numbers"),
    ("shot", '"calm"', '"calm"\nsettle = True', "numbers have a point, booleans are true and"),
    ("shot", '"calm"', '"calm"\nwind = "gust"', "Cannot overwrite a value. Write the key once"),
    ("shot", '"draft"', '"drafts"', "no quality preset 'drafts', did you mean 'draft'?"),
    ("shot", '"draft"', '"ultra"', "known: draft, final, plumage, preview"),
    ("shot", '"flap"', '"flapping"', "no motion preset 'flapping', did you mean"),
    (
        "shot",
        "quency = 1.0",
        "quency = -1.0",
        "motion.wingbeat_frequency: -1 is out of range. Give 0.001 to",
    ),
    ("shot", "quency = 1.0", "quency = 1,0", "Write one key a line; numbers have a point, no com"),
    (
        "shot",
        "wingbeat_frequency = 1.0",
        "frequency = 3.8",
        "does not apply to a motion of kind flap, ",
    ),
    ("shot", "quency = 1.0", "quency = 1\n[motion]", "Write the table once, or an array of tables"),
    ("shot", 'quality = "draft"', "contact = true", "true is not a table. Give { } or a table ["),
    ("shot", 'quality = "draft"', "row = 1", "row: is a key of grooms. Write it in the groom"),
    ("shot", 'name = "swan_wing"', "", "name: missing, expects a text"),
    ("shot", "frames_per_second", "fps", "fps: unknown key, did you mean 'frames_per_second'?"),
    ("shot", '"calm"', "“calm”", "line 6, column 8: Invalid value. Write straight quotes"),
    ("shot", 'quality = "draft"', 'skin = "body.usdc"', "Give { } or a table [skin] of usd, prim"),
    (
        "shot",
        'quality = "draft"',
        "[contact]\nfriction = 5",
        "friction: 5 is out of range. Give 0 to",
    ),
    ("groom", 'region = "primaries"', "length = 0.4", "did you mean overrides.length?"),
    ("shot", 'base = "flap"', "", ":9: motion.kind: missing, expects one of hold, shake, flap, fo"),
    (
        "shot",
        '"calm"',
        "5",
        ":6: wind: 5 is not a wind preset. Give its name in quotes, or a table",
    ),
    ("shot", '"calm"', '"calm"\njobs = 4', "is an option of commands. Write --jobs there"),
    ("shot", '"calm"', '"calm"\npreset_folders = ["."]', "of commands. Write --presets there"),
    ("shot", "[motion]", "[overrides]\nlength = 1\n[motion]", 'Write [overrides."NAME"] above it'),
    ("shot", "[motion]", FLAT, "[1, 0, 12, 35] holds no arrays. Give 1 to 10000 arrays of 2 numb"),
    ("groom", "[[joint]]", "[[joints]]", "joints: unknown key, did you mean 'joint'?"),
    ("groom", ROW, ROWS, "rows: unknown key, did you mean 'row'?"),
    ("groom", "[variation]", "[[variation]]", "Write [variation] with one bracket"),
    ("groom", "first = {", "first = [", "Write keys and their values in { }"),
    ("groom", '[[row]]\nid = "right_p', '[row]\nid = "right_p', "Write [[row]] with two brackets"),
    ("groom", "[-1.0, -0.02, 0.0], up", "'-x', up", "'-x' is not an array. Give 3 numbers"),
    ("shot", '"groom.toml"', '"g/groom.toml"', "groom.toml: there is no such file. Check the path"),
    ("groom", "camber = 1", "camber = 100", "variation.camber: 100 is out of range. Give 0 to 60"),
    ("groom", "roll = 6", "roll = 6000", "row[0].roll ('right_secondary'): 6000 is out of range"),
    ("groom", "length = 0.01", "length = -0.01", "-0.01 is out of range. Give 0 to 0.3"),
    (
        "groom",
        "scale = [0.95",
        'name = "a"\nscale = [0.95',
        "name ('right_secondary'): unknown key",
    ),
    ("groom", "seed = 7", "seed = 7.5", "7.5 is not an integer. Give 0 to"),
    ("groom", "count = 5", 'count = "5"', ":39: row[0].count ('right_secondary'): '5' is not an"),
    ("groom", "scale = [0.95, 1.1]", "scale = [1, 1, 1]", "has 3 items. Give 2"),
    ("groom", '"swan_primary"', '"swan_primaries"', "did you mean 'swan_primary'?"),
    ("groom", '"swan_primary"', "swan_primary", "Invalid value. Put texts in quotes"),
    ("groom", '"right_wrist"\nmirror', '"right_wirst"\nmirror', "did you mean 'right_wrist'?"),
    ("groom", 'role = "wrist"', 'role = "hand"', "known: body, elbow, shoulder, wrist"),
    ("groom", 'parent = "body"', 'parent = "right_wrist"', "Give one of them another parent"),
    ("groom", 'right"\nmirror = "y"', 'right"\nmirror = "w"', "'w' is not allowed, known: x, y, z"),
    ("groom", 'right"\nmirror = "y"', 'right"\nmirror = true', "true is not a text in quotes"),
    (
        "groom",
        "width = 1.5",
        GPA.format("rachis.youngs_modulus"),
        "did you mean rachis_material.yo",
    ),
    ("groom", "width = 1.5", GPA.format("rachis_material.youngs_modulus"), "Give 1000 to 1e+12 Pa"),
    (
        "groom",
        "width = 1.5",
        GPA.format("leading.shear_modulus"),
        "did you mean vane_material.shear_modulus or",
    ),
    (
        "groom",
        "[-1.0, -0.02, 0.0], up",
        "[0, 0, 0], up",
        "first.direction ('right_secondary'): a d",
    ),
    ("groom", "[-1.0, -0.02, 0.0], up", "[0, 0, 1], up", "is parallel to direction. Give another"),
    ("groom", "-0.3, 0.0], up = [0, 0, 1]", "-0.3, 0.0]", "missing, expects an array of 3 numb"),
    ("groom", "[0.095, -0.57, 0.055]", "[0.095, -0.57]", "has 2 items. Give 3"),
    ("groom", 'id = "right_primary"', 'id = "right_secondary"', "and 9 more are taken already"),
    ("groom", "[0.05, -0.08, 0.05]", "[50, -80, 50]", "joint 'right_shoulder' is 107 m from the"),
    ("shot", "[motion]", "[camera]\nfov = 35\n[motion]", "did you mean 'level_of_detail'?"),
    ("shot", "frames = [1, 24]", "end = 24", "end: unknown key, did you mean 'frames'?"),
    ("shot", '"calm"', '{ base = "gust", turbulence = 0.3 }', "key, did you mean 'gust'?"),
    ("shot", "[motion]", "cuts = [300]\n[motion]", "cuts[0]: 300 is not of the shot. Give 1 to 24"),
    ("groom", "width = 1.5", RGB, "colour.base ('right_secondary'): [200, 30, 30] is out of range"),
    ("groom", "width = 1.5", "lenght = 0.4", "did you mean overrides.length?"),
    ("groom", 'kind = "swan_primary"', 'preset = "swan_primary"', "did you mean 'kind'?"),
]
PATCH = '[[region]]\nid = "p"\nkind = "covert"\ncount = {count}\n{more}\n[bird]'
FLOW = "flow = { direction = [-1, 0, 0] }"
# changes of first_bird's groom
ON_BIRDS = [
    ('prim = "/pigeon/body"', 'prim = "/pigeon/bodi"', "no prim /pigeon/bodi in"),
    (
        'prim = "/pigeon/body"',
        'prim = "pigeon/body"',
        "is no absolute prim path such as /Bird/body",
    ),
    ('prim = "/pigeon/body"', 'prim = "/pigeon"', "/pigeon is a SkelRoot, no Mesh. Below it is"),
    (
        'usd = "body.usdc"',
        'usd = "boddy.usdc"',
        "boddy.usdc: there is no such file. Check the path",
    ),
    ('primvar = "beak"', 'primvar = "beek"', "bird.bare[0].primvar: no primvar 'beek' on"),
    ("beak = [0.166,", "beek = [0.166,", "landmarks.beek: unknown key, did you mean 'beak'?"),
    ("beak = [0.166, 0, 0.272]", "beak = [166, 0, 272]", "Give all in one unit"),
    ('"pigeon"', '"pidgeon"', "no bird preset 'pidgeon', did you mean 'pigeon'?"),
    ('{ primvar = "beak" }', '"beak"', "Give { } of keys such as angle, box, facing"),
    ('prim = "/pigeon/body"', 'path = "/pigeon/body"', "unknown key, did you mean 'prim'?"),
    ("[bird]", PATCH.format(count=0, more=FLOW), "count ('p'): 0 is out of range. Give 1 to"),
    ("[bird]", PATCH.format(count=9, more=""), "missing, expects a table of keys such as away"),
    ('"pigeon"', '"eagle"', "known: gull, ostrich, owl, parrot, peacock, pigeon, sparrow, swan"),
]
PULL = "feather_pull/shot.toml"
TYPED = [
    (f"bake {PULL} --qualty draft", "No such option '--qualty'. Did you mean '--quality'?"),
    (f"bake {PULL} --draft", "No such option --draft. Did you mean '--quality draft'?"),
    ("preview first_bird/body.usdc --top", "No such option --top. Did you mean '--view top'?"),
    (f"bake {PULL} --wind gust", "No such option --wind: wind is a key of shots. Write it there"),
    (f"bake {PULL} --frames 1,24", "'1,24' is not a range of frames such as 1-24 or 12"),
    (f"bake {PULL} --feathers 5/4", "'5/4' is not a share such as 1/4, or some such as 1-3/4"),
    (f"bake {PULL} --error 50%", "'50%' is not a number. Give 0.01<=x<=20"),
    (f"bake {PULL} --jobs all", "'all' is not a whole number. Give 1<=x<=1024"),
    (f"bake {PULL} --engine spark", "'spark' is not one of 'local', 'dask'"),
    (f"bake {PULL} --quality fnal -o o.usdc", "no such preset, did you mean 'final'?"),
    (f"bake {PULL} -o o.txt", "suffix '.txt' is not one of .usd, .usda, .usdc"),
    (f"bake {PULL} -o no/such/o.usdc", "no/such: folder does not exist. Make it first"),
    (f"bake {PULL} -o {PULL}", "is an input of this work. Choose another name"),
    (f"bake {PULL} o.usdc", "o.usdc is no shot. Write -o o.usdc for what is written"),
    ("view feather_pull", "feather_pull: is a folder. Name a USD file"),
    (f"bake {PULL} {PULL}", "are for --engine dask. Add it, or bake one shot at a time"),
    ("check feather_pull", "feather_pull: is a folder. Name a file"),
    ("sample feather_pull", "feather_pull: is not empty. Name a new folder with -o"),
    ("presets show swan_prmary", "there is no such preset, did you mean 'swan_primary'?"),
    ("join o.usdc --shares 2", "o.1of2.usdc: is missing. Bake this share first"),
    ("tune swan_primary --wind breze", "wind/breze: there is no such preset, did you mean 'breeze"),
    ("view first_bird/body.usdc --html a.txt", "a.txt: suffix '.txt' is not .html"),
    ("retime first_bird/body.usdc -o r.usdc --speed half", "'half' is not a number. Give x>0"),
    ("preview first_bird/body.usdc -o no/a.png", "no: folder does not exist. Make it first"),
    (f"bake {PULL} --force", "No such option --force. Did you mean '--overwrite'?"),
    (f"bake {PULL} --threads 2", "No such option --threads. Did you mean '--jobs'?"),
    (f"bake {PULL} --fps 30", "frames_per_second is a key of shots. Write it there"),
    (f"bake {PULL} --feathers 3-9/9 -o o.usdc", "no share. Give I/N, I from 1 to N, and N at most"),
    ("help bake", "No such command 'help'. Did you mean '--help'?"),
    ("sculpt first_bird/body.usdc -o o.usdc", "'--with'. Meshes or curves named by feather id"),
    ("export first_bird/body.usdc -o a.fbx", "'.fbx' is not one of .usd, .usda, .usdc, .abc, .glb"),
    ("stats first_bird/body.usdc", "no curves and no instances at / or below."),
    ("plugins install nuke", "'nuke' is not one of 'houdini', 'maya', 'usdvalidation', 'usdview'"),
]


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    for name in ("feather_pull", "first_bird"):
        shutil.copytree(SAMPLES / name, folder / name)
    return folder


def checked(folder, file, old, new):
    """What check tells of a file in which one thing is changed."""
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    done = invoke("check", folder / file)
    (folder / file).write_text(text)
    return [
        line
        for line in (done.stdout + done.stderr).splitlines()
        if "featherfx: read" not in line and " checked, " not in line
    ]


@pytest.mark.parametrize(("file", "old", "new", "told"), IN_FILES)
def test_a_mistake_in_a_file_is_one_line(tmp_path, file, old, new, told):
    shutil.copytree(SAMPLES / "swan_wing", tmp_path, dirs_exist_ok=True)
    (line,) = checked(tmp_path, f"{file}.toml", old, new)
    assert told in line


@pytest.mark.parametrize(("old", "new", "told"), ON_BIRDS)
def test_a_mistake_on_a_bird_is_one_line(samples, old, new, told):
    (line,) = checked(samples / "first_bird", "groom.toml", old, new)
    assert told in line


@pytest.mark.parametrize(("typed", "told"), TYPED)
def test_a_mistake_in_a_command_says_what_to_type(samples, monkeypatch, typed, told):
    monkeypatch.chdir(samples)
    done = invoke(*typed.split())
    assert done.exit_code in (1, 2)
    assert told in done.stderr + done.stdout


@pytest.fixture(scope="module")
def shot(samples):
    return ffx.read_shot(samples / PULL)


FEATHER = {"id": "a", "kind": "covert", "direction": [1, 0, 0], "up": [0, 0, 1]}
IN_PYTHON = [
    (lambda s: ffx.read_shot(3), TypeError, "shot: 3 is of type int. Give the path of a shot file"),
    (lambda s: ffx.read_shot("no.toml"), InputError, "no.toml: there is no such file"),
    (
        lambda s: s.with_overrides({"b": {"scaling": "similar"}}),
        InputError,
        "matches no feather id",
    ),
    (lambda s: s.with_overrides([("*", 1)]), TypeError, 'Give {"PATTERN": {"KEY": VALUE}}'),
    (lambda s: s.with_overrides({"*": 6e9}), TypeError, "Give a dict of keys and values"),
    (lambda s: s.with_overrides({"*": {"rachis.youngs_modulus": 6}}), InputError, "Give 1000 to"),
    (lambda s: s.with_quality("fnal"), InputError, "did you mean 'final'?"),
    (lambda s: s.with_quality(None), TypeError, "quality: None is of type NoneType. Give a pres"),
    (lambda s: s.replace(windd="calm"), InputError, "windd: unknown key, did you mean 'wind'?"),
    (lambda s: s.replace(gravity=[0, 0, float("nan")]), InputError, "nan is not a finite number"),
    (lambda s: ffx.simulate(s, frames=(5, 1)), InputError, r"\(5, 1\) is no range of its frames"),
    (lambda s: ffx.simulate(s, frames=(20, 30)), InputError, r"Give \(first, last\) in 1 to 25"),
    (lambda s: ffx.simulate(s, frames=5), TypeError, r"frames: 5 is of type int. Give \(first, l"),
    (lambda s: ffx.simulate(s, frames=(1.5, 2)), TypeError, "Give whole numbers"),
    (lambda s: ffx.simulate(s.groom), TypeError, "is of type Groom. Give a Shot"),
    (lambda s: ffx.simulate(s, start="x"), TypeError, r"start: 'x' is of type str. Give a checkp"),
    (lambda s: ffx.bake(s, "o.usdc", quallity="draft"), TypeError, "did you mean 'quality'?"),
    (lambda s: ffx.bake(s, "o.usdc", frames="1-5"), TypeError, "Give two whole numbers or None"),
    (lambda s: ffx.bake(s, "o.usdc", jobs="all"), TypeError, "jobs: 'all' is of type str. Give a"),
    (lambda s: ffx.bake(s, "o.usdc", feathers="1/2"), TypeError, "feathers: '1/2' is of type str"),
    (lambda s: ffx.bake(s, "o.usdc", progress="yes"), TypeError, "Give True, or a function of tw"),
    (lambda s: ffx.bake(s, 7), TypeError, "output: 7 is of type int. Give the path of a file"),
    (lambda s: ffx.bake(s, "o"), InputError, "suffix '' is not one of .usd, .usda, .usdc"),
    (lambda s: ffx.build(s), TypeError, "is of type Shot. Give a Groom, such as shot.groom"),
    (lambda s: ffx.build(s.groom, 3), TypeError, "quality: 3 is of type int. Give a preset's name"),
    (lambda s: ffx.open_cache(3), TypeError, "path: 3 is of type int. Give the path of a cache"),
    (lambda s: ffx.check(3), TypeError, "source: 3 is of type int. Give a Shot, a Groom, or the"),
    (lambda s: ffx.stats(3), TypeError, "source: 3 is of type int. Give a Shot, a Groom, or a"),
    (lambda s: ffx.open_cache("no.usdc"), InputError, "no.usdc: there is no such file"),
    (lambda s: ffx.retime("a.usdc", "b.usdc", speed="half"), TypeError, "such as 0.5 for slow mo"),
    (lambda s: ffx.retime("a.usdc", "b.usdc"), InputError, "takes one of speed, keys and loop"),
    (lambda s: ffx.simulate(s, jobs=0), InputError, "jobs: 0 is not allowed. Give 1 or more"),
    (lambda s: ffx.join("x.usdc", shares="2"), TypeError, "shares: '2' is of type str. Give a wh"),
    (lambda s: ffx.join("x.usdc", shares=0), InputError, "shares: 0 is not allowed. Give 1 or mo"),
    (lambda s: ffx.export(s, "x.glb"), TypeError, "Give the path of a cache, such as cache.path"),
    (
        lambda s: ffx.retime(s, "x.usdc", speed=1),
        TypeError,
        "Give the path of a cache, such as cac",
    ),
    (lambda s: ffx.bake_many("a.toml", workers=0), InputError, "workers: 0 is not allowed. Give 1"),
    (lambda s: ffx.bake_many([], "out"), InputError, "no shot is given. Name a shot"),
    (lambda s: ffx.Groom.from_dict("groom.toml"), TypeError, "Give a dict of the keys of the file"),
    (lambda s: ffx.Groom.from_dict({"name": "a", "feather": FEATHER}), InputError, "two brackets"),
    (lambda s: ffx.Groom.from_dict({"name": "a", "feather": [FEATHER]}), InputError, "position: m"),
    (lambda s: ffx.Checkpoint.load(s.source), InputError, "Give a file that Checkpoint.save wrote"),
    (lambda s: s.to_toml("no/such/s.toml"), InputError, "Check the folder"),
    (lambda s: s.to_toml(None), TypeError, "Give the path of a file that ends in .toml"),
    (lambda s: ffx.read_shot(s.source, "my"), TypeError, "preset_folders: 'my' is of type str"),
    (lambda s: ffx.bake(s, "o.usdc", preset_folders=["my"]), InputError, "my: there is no such fo"),
    (lambda s: ffx.read_quality(3), TypeError, "3 is of type int. Give the name of a quality"),
    (lambda s: ffx.Shot.from_dict({"groom": s}), InputError, "is a shot. Give what `groom` of a"),
    (lambda s: ffx.Groom.from_dict({1: 2, "name": "a"}), InputError, "1: unknown key"),
    (lambda s: next(iter(ffx.simulate(s))).points[0], TypeError, "0 is of type int. Give an id"),
    (lambda s: ffx.bake(s, "o.usdc", quality=3), TypeError, "3 is of type int. Give a text or No"),
    (lambda s: ffx.retime("a.usdc", "b.usdc", keys=[1, 2]), InputError, "there is no such file"),
    (lambda s: ffx.expand("a.usdc", rows="41"), TypeError, "'41' is of type str. Give a whole num"),
    (lambda s: ffx.bake_many(s), TypeError, "is of type Shot. Give the paths of shot files"),
    (lambda s: ffx.Checkpoint.load("no.npz"), InputError, "there is no such file. Check the path"),
    (lambda s: ffx.export("a.usdc", "b.glb", frames=3), TypeError, "Give .first, last"),
    (lambda s: ffx.export_groom(s, "a.usdc"), TypeError, "Give the path of a groom file"),
    (lambda s: ffx.check(s, progress=3), TypeError, "Give True, or a function of two numbers"),
]


@pytest.mark.parametrize(("call", "kind", "told"), IN_PYTHON)
def test_a_mistake_in_python_is_an_error_that_says_what_to_give(shot, call, kind, told):
    with pytest.raises(kind, match=told.replace("?", r"\?")):
        call(shot)


def test_coordinates_in_another_unit_are_warned_of():
    far = [FEATHER | {"id": name, "position": [x, 0, 0]} for name, x in (("a", 0.0), ("b", 90.0))]
    with pytest.warns(InputWarning, match="the longest feather has .* Positions are in metres"):
        ffx.Groom.from_dict({"name": "far", "feather": far})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ffx.Groom.from_dict({"name": "near", "feather": [far[0], far[1] | {"position": [1, 0, 0]}]})
