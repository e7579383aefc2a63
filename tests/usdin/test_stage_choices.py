"""What is taken of a stage: variants, purposes and visibility, by the keys of a table."""

import pytest
from pxr import UsdGeom
from usdin_scenes import add_curves, add_mesh, arc, lifted, new_stage, sheet

from featherfx.api import read_groom, read_shot
from featherfx.baking.export import export_groom
from featherfx.errors import InputError
from featherfx.usd.read.cache import Cache

FEATHER = '[[feather]]\nid = "f"\nkind = "covert"\nposition = [0, 0, 0]\n'
SHOT = 'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n'


def add_variants(stage, path="/b", name="look", variants=("empty", "bird", "low")):
    """A prim whose variants hold nothing, a sheet at z = 0, and one at z = 1."""
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    own = prim.GetVariantSets().AddVariantSet(name)
    points, counts, quads = sheet(2, 2)
    for number, variant in enumerate(variants):
        own.AddVariant(variant)
        own.SetVariantSelection(variant)
        if number:
            with own.GetVariantEditContext():
                add_mesh(stage, f"{path}/skin", lifted(points, number - 1), counts, quads)
    own.SetVariantSelection(variants[0])


@pytest.fixture(name="stage")
def stage_with_variants(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    add_variants(stage)
    stage.GetRootLayer().Save()
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{FEATHER}')
    return stage


def read_table(folder, table):
    (folder / "shot.toml").write_text(SHOT + table)
    return read_shot(folder / "shot.toml")


SKIN = '[skin]\nusd = "skin.usda"\nprim = "/b/skin"\n'
COLLIDER = '[contact]\n[[collider]]\nusd = "skin.usda"\nprims = ["skin"]\n'
CHOSEN = 'variant_sets = { look = "low" }\n'


def test_a_skin_of_a_variant_is_read_where_it_is_chosen(tmp_path, stage):
    with pytest.raises(InputError, match=r"'look' of /b has .*'empty' is chosen.*variant_sets"):
        read_table(tmp_path, SKIN)
    skin = read_table(tmp_path, SKIN + CHOSEN + "tolerance = 2\n").skin
    assert skin.parts[0].surface.rest[:, 2].max() == 1.0
    (collider,) = read_table(tmp_path, COLLIDER + CHOSEN).colliders
    assert collider.surface.rest[:, 2].min() == 1.0
    # the stage stays as it is
    assert stage.GetPrimAtPath("/b").GetVariantSet("look").GetVariantSelection() == "empty"


def test_variants_within_variants_are_chosen_together(tmp_path, stage):
    look = stage.GetPrimAtPath("/b").GetVariantSet("look")
    look.SetVariantSelection("bird")
    with look.GetVariantEditContext():
        add_variants(stage, "/b/inner", "size", ("none", "small", "large"))
    look.SetVariantSelection("empty")
    stage.GetRootLayer().Save()
    table = SKIN.replace("/b/skin", "/b/inner/skin") + "tolerance = 2\n"
    both = 'variant_sets = { size = "large", look = "bird" }\n'
    skin = read_table(tmp_path, table + both).skin
    assert skin.parts[0].surface.rest[:, 2].max() == 1.0


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ('{ looks = "bird" }', "no variant set 'looks'"),
        ('{ look = "brd" }', "'look' has no variant 'brd'.*'bird'"),
        ("{ look = 3 }", "3 is not a text"),
        ('"bird"', "is not a table of texts"),
    ],
)
def test_wrong_choices_are_refused_with_those_that_there_are(tmp_path, stage, chosen, message):
    with pytest.raises(InputError, match=rf"variant_sets.*{message}"):
        read_table(tmp_path, f"{SKIN}variant_sets = {chosen}\n")


def test_a_picture_of_a_groom_shows_the_variant_that_was_groomed(tmp_path, stage):
    region = '[[region]]\nid = "r"\nkind = "covert"\ncount = 5\nflow = { direction = [1, 0, 0] }\n'
    (tmp_path / "grown.toml").write_text(f'name = "g"\n{SKIN}{CHOSEN}{region}')
    export_groom(tmp_path / "grown.toml", tmp_path / "out.usda")
    (entry,) = Cache(tmp_path / "out.usda").scenery
    other = Cache(tmp_path / entry["file"], entry["variant_sets"])
    assert other.points(0)[:, 2].min() == 1.0


def add_hidden(stage):
    """Curves and sheets: drawn, invisible, guide and proxy."""
    for number, name in enumerate(("drawn", "hidden", "guide", "proxy")):
        shift = [0.1 * number, 0, 0]
        UsdGeom.Xform.Define(stage, f"/b/{name}")
        for prim in (
            add_curves(stage, f"/b/{name}/curve", [arc() + shift]),
            add_mesh(stage, f"/b/{name}/body", *sheet(1, 1)),
        ):
            if name in ("guide", "proxy"):
                prim.CreatePurposeAttr(name)
        if name == "hidden":
            UsdGeom.Imageable(stage.GetPrimAtPath("/b/hidden")).MakeInvisible()
    stage.GetRootLayer().Save()


MORE = [
    ("", ["drawn"]),
    ("invisible = true\n", ["drawn", "hidden"]),
    ('purposes = ["default", "guide"]\n', ["drawn", "guide"]),
    ('purposes = ["proxy"]\n', ["proxy"]),
]


@pytest.mark.parametrize(("keys", "expected"), MORE)
def test_what_is_drawn_is_read_unless_a_key_says_otherwise(tmp_path, keys, expected):
    add_hidden(new_stage(tmp_path / "set.usda"))
    (tmp_path / "groom.toml").write_text(f'name = "g"\n[[usd]]\nfile = "set.usda"\n{keys}')
    places = [round(10 * f.position[0]) for f in read_groom(tmp_path / "groom.toml").feathers]
    assert places == [("drawn", "hidden", "guide", "proxy").index(name) for name in expected]
    table = f'[contact]\n[[collider]]\nusd = "set.usda"\nprims = ["body"]\n{keys}'
    paths = [each.surface.path for each in read_table(tmp_path, table).colliders]
    assert paths == [f"/b/{name}/body" for name in expected]


def test_a_path_names_a_prim_that_is_not_drawn(tmp_path):
    add_hidden(new_stage(tmp_path / "set.usda"))
    groom = 'name = "g"\n[[usd]]\nfile = "set.usda"\nprims = ["/b/guide/curve"]\n'
    (tmp_path / "groom.toml").write_text(groom)
    assert len(read_groom(tmp_path / "groom.toml").feathers) == 1
    table = '[contact]\n[[collider]]\nusd = "set.usda"\nprims = ["/b/hidden/body"]\n'
    assert len(read_table(tmp_path, table).colliders) == 1
