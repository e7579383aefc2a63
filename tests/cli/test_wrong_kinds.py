"""Files of one kind given to commands that want another: one line that says what the file is."""

import pytest
from commands import invoke
from places import ROOT

GROOM, SHOT = "samples/swan_wing/groom.toml", "samples/feather_pull/shot.toml"
PRESETS = {
    "feather": "presets/feather/covert.toml",
    "quality": "presets/quality/draft.toml",
    "wind": "presets/wind/breeze.toml",
    "motion": "presets/motion/flap.toml",
    "material/vane": "presets/material/vane",
}
STAGE = "samples/pigeon/body.usdc"
OF_SHOTS, OF_GROOMS = ("bake", "bake --plan 2"), ("groom", "stats")
OF_STAGES = ("inspect", "preview", "export")
OUTPUTS = {"preview": "out.png", "inspect": "", "stats": ""}


def told(command, file, folder):
    """The one line that a command says of a file."""
    name, *more = command.split()
    output = OUTPUTS.get(name, "out.usdc")
    more += ["-o", str(folder / output)] if output else []
    done = invoke(name, file, *more)
    assert done.exit_code == 1, done.output
    assert isinstance(done.exception, SystemExit)
    assert list(folder.glob("out*")) == []
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"featherfx: {file}: ")
    return line.removeprefix(f"featherfx: {file}: ")


@pytest.mark.parametrize("family", PRESETS)
@pytest.mark.parametrize("command", [*OF_SHOTS, *OF_GROOMS])
def test_a_preset_is_called_one(command, family, tmp_path):
    path = ROOT / PRESETS[family]
    file = path if path.is_file() else sorted(path.glob("*.toml"))[0]
    wanted = "groom" if command in OF_GROOMS else "shot"
    assert told(command, file, tmp_path) == f"is a {family} preset, expects a {wanted}."


@pytest.mark.parametrize("command", OF_SHOTS)
def test_what_is_no_shot(command, tmp_path):
    assert told(command, ROOT / GROOM, tmp_path).startswith("is a groom, expects a shot")
    assert told(command, ROOT / STAGE, tmp_path).startswith("is a USD file, expects a shot")


def test_what_is_no_groom(tmp_path):
    assert (
        told("groom", ROOT / SHOT, tmp_path)
        == "is a shot, expects a groom, as its key groom names one."
    )


@pytest.mark.parametrize("command", OF_STAGES)
@pytest.mark.parametrize("file", [GROOM, SHOT, *list(PRESETS.values())[:1]])
def test_toml_is_no_stage(command, file, tmp_path):
    expected = (
        "is a TOML file: a groom, shot or preset, expects .usd, .usda or .usdc. `featherfx groom`"
        " and `featherfx bake` write one."
    )
    assert told(command, ROOT / file, tmp_path) == expected


@pytest.mark.parametrize("command", [*OF_SHOTS, *OF_GROOMS, *OF_STAGES])
@pytest.mark.parametrize("kind", ["json", "csv", "png", "folder", "nothing"])
def test_what_is_nothing_of_ours(command, kind, tmp_path):
    file = tmp_path / f"a.{kind}"
    if kind == "folder":
        file.mkdir()
    elif kind != "nothing":
        content = {"json": b'{"shot": "a"}', "csv": b"id,x\na,1\n", "png": b"\x89PNG\r\n\x1a\n"}
        file.write_bytes(content[kind])
    words = ("not valid TOML", "is not UTF-8", "is no USD file", "is a folder", "no such file")
    line = told(command, file, tmp_path)
    assert any(each in line for each in (*words, "there is no such file")), line
