"""No option of any command can make it write over one of its inputs."""

import click
import pytest
from commands import invoke
from places import SAMPLES

from featherfx.cli.main import main

REQUIRED = {"--speed": "0.5", "--rigid": "1", "--keys": "2", "--size": "32x32", "--shares": "2"}


def commands_in(group, *names):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands_in(command, *names, name)
        else:
            yield (*names, name), command


def is_input(param):
    return isinstance(param.type, click.Path) and (param.type.exists or not param.type.readable)


def is_output(param):
    """Whether it names a file to write; click refuses a file in the place of a folder."""
    return isinstance(param.type, click.Path) and not is_input(param) and param.type.file_okay


CASES = [
    pytest.param(names, command, read, written, id=f"{' '.join(names)} {read.name} {written.name}")
    for names, command in commands_in(main)
    for read in command.params
    for written in command.params
    if is_input(read) and is_output(written) and "--log" not in written.opts
]


def given(param, value):
    """Arguments that give a value to a parameter."""
    return [value] if isinstance(param, click.Argument) else [param.opts[0], value]


@pytest.mark.parametrize(("names", "command", "read", "written"), CASES)
def test_an_output_is_never_an_input(tmp_path, names, command, read, written):
    file = tmp_path / "input.toml"
    file.write_text("name = 'kept'\n")
    source = str(tmp_path if getattr(read.type, "file_okay", True) is False else file)
    arguments = given(read, source) + given(written, str(file))
    flags = [flag for each in command.params for flag in each.opts]
    arguments += ["--overwrite"] if "--overwrite" in flags else []
    for each in command.params:
        if each.required and each not in (read, written):
            other = "other.toml" if is_input(each) else "out.usdc"
            value = str(tmp_path / other) if isinstance(each.type, click.Path) else "x"
            arguments += given(each, REQUIRED.get(each.opts[0], value))
    done = invoke(*names, *arguments)
    assert done.exit_code == 1, done.output
    assert f"{file}: is an input of this work. Choose another name" in done.stderr
    assert file.read_text() == "name = 'kept'\n"
    assert len(list(tmp_path.iterdir())) == 1


def test_there_are_commands_that_read_and_write():
    found = {case.values[0][0] for case in CASES}
    assert {"bake", "groom", "export", "retime", "preview", "trace", "view"} <= found


def test_what_an_input_names_is_an_input_too(tmp_path):
    for name in ("shot", "groom"):
        text = (SAMPLES / f"feather_pull/{name}.toml").read_text()
        (tmp_path / f"{name}.toml").write_text(text)
    groom = tmp_path / "groom.toml"
    before = groom.read_bytes()
    out = ("-o", tmp_path / "out.usdc", "--report", groom, "--overwrite")
    done = invoke("bake", tmp_path / "shot.toml", *out)
    assert done.exit_code == 1
    assert f"{groom}: is an input of this work" in done.stderr
    assert groom.read_bytes() == before


def test_files_that_name_each_other_are_no_circle(tmp_path):
    (tmp_path / "a.toml").write_text('other = "b.toml"')
    (tmp_path / "b.toml").write_text('other = "a.toml"')
    done = invoke("groom", tmp_path / "a.toml", "-o", tmp_path / "b.toml", "--overwrite")
    assert f"{tmp_path / 'b.toml'}: is an input of this work" in done.stderr


def test_an_option_is_no_name_of_an_output(tmp_path):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    done = invoke("view", tmp_path / "a.usda", "--html", "-o")
    assert done.exit_code == 2
    assert "'-o' looks like an option. Write './-o' for a file of that name" in done.stderr


@pytest.mark.parametrize("length", [221, 240, 250])
def test_a_name_that_is_too_long_is_refused_before_the_work(tmp_path, length):
    name = "n" * (length - 5) + ".usdc"
    done = invoke("bake", SAMPLES / "feather_pull/shot.toml", "-o", tmp_path / name)
    assert done.exit_code == 1
    assert f"its name takes {length} bytes. Give one of at most 220" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_longest_name_works(tmp_path):
    name = "n" * 215 + ".usdc"
    shot = SAMPLES / "feather_pull/shot.toml"
    out = ("-o", tmp_path / name, "--frames", "1-3", "--quality", "draft")
    for layout in ("flat", "payload", "clips"):
        done = invoke("bake", shot, *out, "--layout", layout, "--overwrite")
        assert done.exit_code == 0, done.stderr
