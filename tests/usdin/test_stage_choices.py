"""What is taken of a stage: variants, purposes and visibility, by the keys of a table."""

import numpy as np
import pytest
from pxr import UsdGeom, UsdUtils
from usdin_scenes import add_curves, add_mesh, arc, lifted, new_stage, sheet

from featherfx.api import read_groom, read_shot
from featherfx.baking.export import export_groom
from featherfx.errors import InputError, InputWarning
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import find_scenery, open_scenery

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


def test_feathers_of_a_variant_are_read_where_it_is_chosen(tmp_path, stage):
    look = stage.GetPrimAtPath("/b").GetVariantSet("look")
    for variant, shift in (("bird", 0.0), ("low", 0.5)):
        look.SetVariantSelection(variant)
        with look.GetVariantEditContext():
            add_curves(stage, "/b/curve", [np.add(arc(), (shift, 0.0, 0.0))])
    stage.GetRootLayer().Save()
    path = tmp_path / "groom.toml"
    places = {}
    for variant in ("bird", "low"):
        chosen = f'variant_sets = {{ look = "{variant}" }}\n'
        path.write_text(f'name = "g"\n[[usd]]\nfile = "skin.usda"\n{chosen}')
        (feather,) = read_groom(path).feathers
        places[variant] = feather.position[0]
    assert places["low"] - places["bird"] == pytest.approx(0.5)


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
    skin = open_scenery(tmp_path / entry["file"], entry)
    assert skin.points(None)[:, 2].min() == 1.0


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


def write_body(path, meters_per_unit=1.0, **samples):
    stage = new_stage(path, meters_per_unit)
    mesh = add_mesh(stage, "/b/skin", *sheet(2, 2))
    for name, values in samples.items():
        for code, value in values.items():
            mesh.GetPrim().GetAttribute(name).Set(value, code)
    stage.GetRootLayer().Save()
    return stage


@pytest.mark.parametrize(
    "name", ["a.usdz", "a.usdz[b.usda]", "sub\\\\b.usda", ".\\\\sub\\\\b.usda"]
)
def test_a_stage_is_found_by_the_names_that_programs_write(tmp_path, name):
    (tmp_path / "sub").mkdir()
    write_body(tmp_path / "sub" / "b.usda")
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "sub" / "b.usda"), str(tmp_path / "a.usdz"))
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{FEATHER}')
    skin = read_table(tmp_path, f'[skin]\nusd = "{name}"\nprim = "/b/skin"\n').skin
    assert len(skin.parts[0].surface.triangles) == 8


def test_a_body_in_a_package_is_drawn_beside_its_feathers(tmp_path):
    write_body(tmp_path / "b.usda")
    package = tmp_path / "a.usdz"
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "b.usda"), str(package))
    entry = {"role": "skin", "file": f"{package.name}[b.usda]", "prim": "/b/skin", "start": 0.0}
    entry |= {"first": 0.0, "time_codes_per_frame": 1.0}
    (scene,) = find_scenery([entry], tmp_path / "cache.usda", ("skin",), "drawn")
    assert scene.surface.path == "/b/skin"


@pytest.mark.parametrize("name", ["a.usdz[c.usda]", "no.usdz[b.usda]", "sub\\\\c.usda"])
def test_a_stage_that_is_not_there_is_one_message(tmp_path, name):
    write_body(tmp_path / "b.usda")
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "b.usda"), str(tmp_path / "a.usdz"))
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{FEATHER}')
    with pytest.raises(
        InputError, match=r"skin\.usd: .*(a.usdz has no c.usda. Give b.usda|there is no such file)"
    ) as caught:
        read_table(tmp_path, f'[skin]\nusd = "{name}"\nprim = "/b/skin"\n')
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("arc", ["sublayer", "reference", "payload"])
@pytest.mark.parametrize(
    ("file", "message"),
    [("no.usda", "no.usda: is missing"), ("cm.usda", r"cm.usda has 0.01 m per unit, the stage 1")],
)
def test_layers_that_are_missing_or_of_other_units_are_told(tmp_path, arc, file, message):
    write_body(tmp_path / "cm.usda", 0.01)
    stage = write_body(tmp_path / "skin.usda")
    prim = stage.DefinePrim("/b/more")
    if arc == "sublayer":
        stage.GetRootLayer().subLayerPaths.append(f"./{file}")
    elif arc == "reference":
        prim.GetReferences().AddReference(f"./{file}", "/b")
    else:
        prim.GetPayloads().AddPayload(f"./{file}", "/b")
    stage.GetRootLayer().Save()
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{FEATHER}')
    with pytest.warns(InputWarning, match=message):
        assert read_table(tmp_path, SKIN).skin is not None


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ({"faceVertexCounts": {1: [4, 4, 4, 4], 2: [4, 4, 4]}}, "faceVertexCounts .*time code 2"),
        ({"points": {1: [(0, 0, 0)] * 9, 3: [(0, 0, 0)] * 8}}, "has 8 points at time code 3"),
        ({"faceVertexIndices": {4: [0] * 16, 5: [1] * 16}}, "faceVertexIndices .*time code 4"),
    ],
)
def test_a_topology_that_changes_is_refused_with_the_time(tmp_path, samples, message):
    write_body(tmp_path / "skin.usda", **samples)
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{FEATHER}')
    with pytest.raises(InputError, match=message.replace(" .*", ".*")):
        read_table(tmp_path, SKIN)
