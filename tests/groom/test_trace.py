"""Presets out of pictures: of feathers that are known, so that what is found can be compared."""

from __future__ import annotations

import numpy as np
import photos
import pytest
from commands import invoke
from PIL import Image

from featherfx.feather.profiles import build_rachis
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import kind_of
from featherfx.groom.presets.library import Library
from featherfx.groom.presets.library import plain as plain_tree
from featherfx.groom.presets.presets import load_preset


def kind(text):
    """Of a feather preset's text, as it lies flat."""
    from featherfx.trace.trace import flattened, kind_of_text

    return flattened(kind_of_text(text))


def traced(tmp_path, image, *options):
    photo, out = tmp_path / "photo.png", tmp_path / "feather" / "found.toml"
    out.parent.mkdir(exist_ok=True)
    image.save(photo)
    arguments = ["trace", str(photo), "-o", str(out), "--length", "0.35", "--overwrite", *options]
    result = invoke(*arguments)
    return result, out


def angles_at(vane, places):
    """deg, of the middle of the barbs."""
    own = [guide.position for guide in vane.guides]
    return np.interp(places, own, [g.angle - 0.5 * g.curl for g in vane.guides])


@pytest.mark.parametrize(
    ("text", "turn", "mirrored", "dusk"),
    [
        ('base = "swan_primary"\n', 37.0, False, 0.0),
        ('base = "tail_feather"\nlength = 0.35\n', 200.0, True, 0.25),
        ('base = "swan_primary"\nrachis.sweep = 0\nrachis.course = [[0, 0, 0, 0], '
         "[0.4, 0, 14, 0], [0.8, 0, -6, 0], [1, 0, -8, 0]]\n", -80.0, False, 0.0),
    ],
)  # fmt: skip
def test_a_feather_is_found_again(tmp_path, text, turn, mirrored, dusk):
    true = kind(text)
    image, _ = photos.picture(true, np.radians(turn), mirrored, noise=3.0, dusk=dusk)
    result, out = traced(tmp_path, image, "--overlay", str(tmp_path / "over.png"))
    assert result.exit_code == 0, result.output
    assert float(result.output.split("within ")[1].split(" %")[0]) < 1.0
    found = kind(out.read_text())
    assert found.calamus == pytest.approx(true.calamus, abs=0.02)
    assert found.rachis.diameter_base == pytest.approx(true.rachis.diameter_base, rel=0.1)
    # shafts lie over each other where their ends do, whatever their base's own direction
    shapes = []
    for each in (true, found):
        line = build_rachis(each, 101).position[:, :2] / each.length
        end = complex(*line[-1])
        shapes.append((line[:, 0] + 1j * line[:, 1]) * abs(end) / end)
    assert np.abs(shapes[0] - shapes[1]).max() < 0.01
    for one, other in ((found.leading, true.leading), (found.trailing, true.trailing)):
        places = np.linspace(0.3, 0.8, 6)
        assert np.abs(angles_at(one, places) - angles_at(other, places)).max() < 6.0
        widest = [max(y for _, y in vane.outline) for vane in (one, other)]
        assert widest[0] == pytest.approx(widest[1], rel=0.1)
    over = np.asarray(Image.open(tmp_path / "over.png"))
    assert over.shape[:2] == (image.height, image.width)
    assert ((over == (255, 190, 0)).all(axis=-1)).sum() > 500  # the shaft is drawn


@pytest.mark.nightly
@pytest.mark.parametrize("base", ["swan_primary", "tail_feather"])
def test_corners_that_lie_in_the_dark_are_no_feather(tmp_path, base):
    """Light that falls off as the fourth power of the way from the middle, which no parabola does,
    on a shaft with three inflections."""
    bent = "rachis.sweep = 0\nrachis.course = [[0, 0, 0, 0], [0.15, 0, 0, 0], [0.4, 0, 22, 0],"
    bent += " [0.7, 0, -20, 0], [0.8, 0, -18, 0], [1, 0, 16, 0]]\n"
    true = kind(f'base = "{base}"\nlength = 0.35\n{bent if base == "swan_primary" else ""}')
    image, _ = photos.picture(true, 0.5, size=500, noise=4.0)
    result, _ = traced(tmp_path, photos.vignetted(image, 0.3))
    assert result.exit_code == 0, result.output
    assert float(result.output.split("within ")[1].split(" %")[0]) < 1.0


def test_a_calamus_that_grain_hides_is_found(tmp_path):
    """Its colour is about as far from the ground as the grain of single pixels."""
    true = kind('base = "swan_primary"\n')
    pale = tuple(each - 15 for each in photos.GROUND)
    image, _ = photos.picture(true, 0.2, size=900, noise=6.0, shaft_colour=pale)
    result, out = traced(tmp_path, image)
    assert result.exit_code == 0, result.output
    assert float(result.output.split("within ")[1].split(" %")[0]) < 1.0
    assert kind(out.read_text()).calamus == pytest.approx(true.calamus, abs=0.02)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "size"), [("jpg", 500), ("jpg", 250), ("grey16.png", 500), ("grey.tif", 500)]
)
def test_other_kinds_of_files_are_as_good(tmp_path, name, size):
    """JPEG smears a thin calamus; 16 bits and floats are no whites."""
    true = kind('base = "swan_primary"\n')
    image, _ = photos.picture(true, 0.2, size=size, noise=1.0)
    if name.startswith("grey"):
        grey = np.asarray(image, dtype=np.float64).mean(axis=-1)
        image = Image.fromarray(
            (257.0 * grey).astype(np.uint16) if "16" in name else grey.astype(np.float32)
        )
    photo, out = tmp_path / f"photo.{name}", tmp_path / "found.toml"
    image.save(photo, **({"quality": 80} if name == "jpg" else {}))
    result = invoke("trace", photo, "-o", out, "--length", "0.35")
    assert result.exit_code == 0, result.output
    assert float(result.output.split("within ")[1].split(" %")[0]) < 2.0
    assert kind(out.read_text()).calamus == pytest.approx(true.calamus, abs=0.03)


def test_a_mask_needs_its_shaft_and_keeps_the_base_s_barbs(tmp_path):
    true = kind('base = "swan_primary"\n')
    image, shaft = photos.picture(true, 0.3, textured=False)
    result, out = traced(tmp_path, image)
    assert (result.exit_code, out.exists()) == (1, False)
    assert "the shaft does not show" in result.output
    points = " ".join(f"{x:.0f},{y:.0f}" for x, y in shaft[:: len(shaft) // 4])
    result, out = traced(tmp_path, image, "--shaft", points, "--base", "swan_primary")
    assert result.exit_code == 0, result.output
    assert "barbs seen at 0 places of the leading and 0" in result.output
    assert float(result.output.split("within ")[1].split(" %")[0]) < 1.0
    found = kind(out.read_text())
    assert [g.angle for g in found.leading.guides] == [g.angle for g in true.leading.guides]


def test_the_preset_can_be_used_by_its_name(tmp_path):
    image, _ = photos.picture(kind('base = "swan_primary"\n'), 0.1)
    traced(tmp_path, image)
    library = Library([tmp_path], Problems())
    tree = library.load_file("feather", tmp_path / "feather" / "found.toml")
    place = Place("found", "", library.problems)
    read = kind_of("found", library.finish("feather", tree, place), place)
    assert not len(library.problems)
    # what a picture cannot tell is the base's
    _, base = load_preset("feather/primary")
    assert read.rachis.camber == plain_tree(base)["rachis"]["camber"] != 0.0


def plain(size, colour=(255, 255, 255)):
    return Image.new("RGB", size, colour)


def stain():
    """As long as a feather, and nothing like one within."""
    rng = np.random.default_rng(3)
    pixels = np.full((220, 560, 3), 255)
    for column in range(40, 520):
        half = int(20 + 60 * abs(np.sin(column / 25.0)))
        pixels[110 - half : 110 + half, column] = rng.integers(0, 120, (2 * half, 3))
    return Image.fromarray(pixels.astype(np.uint8))


def disc():
    image = plain((300, 300))
    pixels = np.array(image)
    row, column = np.indices((300, 300))
    pixels[(row - 150) ** 2 + (column - 150) ** 2 < 80**2] = 0
    return Image.fromarray(pixels)


def halves():
    """Two vanes, and between them a shaft of the ground's colour."""
    image = plain((300, 300))
    pixels = np.array(image)
    pixels[20:280, 120:145] = pixels[20:280, 155:200] = 0
    return Image.fromarray(pixels)


@pytest.mark.parametrize(
    ("image", "options", "code", "told"),
    [
        (halves(), (), 1, "two pieces differ from the border, one 56 % as large"),
        (plain((200, 300)), (), 1, "no silhouette: 0 % of the picture"),
        (disc(), (), 1, "about as wide as long"),
        (stain(), ("--shaft", "45,110 500,110"), 1, "photo.png: what was found is no feather"),
        (plain((200, 300)), ("--shaft", "1,2 x"), 2, "no list of pixels"),
        (stain(), ("--shaft", "nan,nan 3,4"), 1, "shaft: needs two points or more, COLUMN,ROW"),
        (stain(), ("--shaft", "1,2 inf,4"), 1, "shaft: needs two points or more, COLUMN,ROW"),
        (plain((200, 300)), ("--threshold", "2"), 2, "threshold"),
        (plain((200, 300)), ("--base", "nobody"), 1, "nobody"),
    ],
)
def test_pictures_without_a_feather_are_refused(tmp_path, image, options, code, told):
    result, out = traced(tmp_path, image, *options)
    assert (result.exit_code, out.exists()) == (code, False), result.output
    assert told in result.output


def test_what_is_no_picture_is_refused(tmp_path):
    photo = tmp_path / "photo.png"
    photo.write_text("no picture")
    result = invoke("trace", photo, "-o", tmp_path / "a.toml")
    assert result.exit_code == 1
    assert "is no picture that can be read" in result.output
    image, _ = photos.picture(kind('base = "swan_primary"\n'), size=300)
    image.save(photo)
    (tmp_path / "a.toml").write_text("mine")
    result = invoke("trace", photo, "-o", tmp_path / "a.toml")
    assert "exists already" in result.output
    assert (tmp_path / "a.toml").read_text() == "mine"
