"""The documents: examples in Python run as they stand, and the site builds without warnings."""

import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pages as pages_of_docs
import pytest
from click import UsageError
from click.testing import CliRunner
from page_runs import pages_with_commands
from pages import (
    best_pages,
    check,
    describe_commands,
    faults,
    faults_of_all,
    made_blocks,
    pages,
    read_page,
)
from PIL import Image
from redraw import Drawer, missing_inputs, recipe, recipes, steps_of

import featherfx
from featherfx.baking.install import copy_sample
from featherfx.cli.main import main
from featherfx.errors import InputError
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import Table
from featherfx.shot.flock import FLOCK_FILE
from featherfx.shot.read.keys import SHOT_FILE
from featherfx.usd.read.cache import Cache

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What is known after the examples of docs/python.md, and the folder in which they ran."""
    folder, before = tmp_path_factory.mktemp("python"), Path.cwd()
    copy_sample("feather_pull", folder / "feather_pull")
    text = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    assert len(blocks) == 6
    known = {}
    os.chdir(folder)
    try:
        for block in blocks:
            exec(compile(block, "docs/python.md", "exec"), known)
    finally:
        os.chdir(before)
    return known, folder


def test_twenty_short_examples_run_in_their_order(tmp_path, monkeypatch):
    for sample in ("feather_pull", "swan_wing"):
        copy_sample(sample, tmp_path / sample)
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs/examples.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    assert len(blocks) == 21
    known = {}
    for block in blocks:
        exec(compile(block, "docs/examples.md", "exec"), known)
    slow, joined = (featherfx.open_cache(tmp_path / name) for name in ("slow.usdc", "parts.usdc"))
    assert len(slow) == len(joined) == 20


def test_the_loop_of_the_page_writes_what_a_bake_writes(ran):
    _, folder = ran
    baked, own = Cache(folder / "pull.usdc"), Cache(folder / "own.usdc")
    for code in (1.0, 2.0, 3.0):
        np.testing.assert_array_equal(baked.points(0, code), own.points(0, code))


def test_a_simulation_goes_on_from_a_checkpoint_with_other_loads(ran):
    known, _ = ran
    shot, half = known["shot"], known["half"]
    on, whole, fallen = (
        [frame.rows[0] for frame in featherfx.simulate(each, frames=(6, 8), start=start)]
        for each, start in ((shot, half), (shot, None), (known["fallen"], half))
    )
    np.testing.assert_array_equal(on, whole)
    # the grip holds the tip; the middle of the shaft sinks
    middle = shot.quality.rows // 2
    sunk = on[-1][middle, 0, 2] - fallen[-1][middle, 0, 2]
    assert 1e-6 < sunk < 1e-3


def test_a_checkpoint_of_another_grid_is_refused(ran):
    known, folder = ran
    shot = featherfx.read_shot(folder / "feather_pull/shot.toml")
    with pytest.raises(InputError, match="start: is of other feathers or another quality"):
        featherfx.simulate(shot, start=known["half"])


@pytest.mark.nightly
def test_the_notebook_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    copy_sample("feather_pull", tmp_path / "feather_pull")
    monkeypatch.chdir(tmp_path)
    cells = json.loads((ROOT / "docs/notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    assert all(each["outputs"] == [] for each in cells if each["cell_type"] == "code")
    known = {}
    monkeypatch.setenv("MPLBACKEND", "Agg")
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "docs/notebook.ipynb", "exec"), known)
    assert len(capsys.readouterr().out.splitlines()) == 24
    assert len(known["axes"].collections) == 2
    # the wind from below lifts the softer one higher
    assert known["after"][-1] > known["before"][-1] + 1.0


@pytest.mark.nightly
def test_the_site_builds_without_warnings(tmp_path):
    missing = [name for name in ("mkdocs", "mkdocstrings") if not importlib.util.find_spec(name)]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed (extra docs)")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", tmp_path / "site"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    page = (tmp_path / "site/api/index.html").read_text(encoding="utf-8")
    assert "featherfx.api.simulate" in page
    assert (tmp_path / "site/search/search_index.json").is_file()


def test_docs_check(capsys):
    """Prints words by page, and fails on each rule."""
    assert check() == 0, capsys.readouterr().out


def test_the_page_of_commands_is_what_help_prints():
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    assert page == describe_commands(), "run python -m tests.pages commands"


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        pytest.param(command, shown, id=command)
        for page in pages()
        for command, shown in made_blocks(page.text)
        if command != "featherfx lab measure house"  # changes with each line of code
    ],
)
def test_tables_are_what_their_commands_print(command, shown):
    result = CliRunner().invoke(main, shlex.split(command)[1:])
    assert result.stdout.strip() == shown.strip()


def test_pages_that_take_longer_or_show_nothing_are_noticed():
    every = [replace(page, words=2_000, text="") for page in pages()]
    found = faults_of_all(every)
    assert "farm: 20.0 minutes of reading, 8 allowed" in found
    assert "farm.md: 0 images of the result, 4 needed" in found
    assert f"{2_000 * len(every)} words, 40000 allowed" in found


def test_films_that_are_too_short_or_too_large_are_noticed(tmp_path, monkeypatch):
    noise = np.random.default_rng(1).integers(0, 256, (24, 200, 400), np.uint8)
    first, *others = (Image.fromarray(each) for each in noise)
    (tmp_path / "docs").mkdir()
    film = tmp_path / "docs/film.gif"
    first.save(film, save_all=True, append_images=others, duration=[*[40] * 23, 100])
    every = pages()
    monkeypatch.setattr(pages_of_docs, "ROOT", tmp_path)
    size = film.stat().st_size
    told = [
        f"film.gif: {size} bytes, 1000000 allowed",
        "film.gif: plays for 1.02 s, 5 to 10 allowed",
    ]
    assert faults_of_all(every) == told


def test_what_is_in_motion_is_shown_by_a_film():
    films = {
        image.stem for image, (_, steps) in recipes().items() if image.suffix == ".gif" and steps
    }
    named = "channels contact levels pigeon_walk qualities splitting target"
    assert films == set(named.split())


def test_a_command_that_two_images_need_runs_once(tmp_path, monkeypatch):
    page = """
        featherfx bake a.toml -o a.usdc
        featherfx preview a.usdc -o one.png
        featherfx preview a.usdc -o two.png
        featherfx bake b.toml -o a.usdc
        featherfx preview a.usdc -o three.png
    """
    ran, steps = [], steps_of(page)
    drawer = Drawer(tmp_path)
    monkeypatch.setattr(drawer, "_run", lambda step: ran.append(step.words[2]) or True)
    for name in ("one.png", "two.png", "one.png"):
        assert drawer.draw(recipe(steps[:3], name), name) == tmp_path / name
    assert ran == ["a.toml", "a.usdc", "a.usdc"]
    # what another command has written under the same name is no cache of this one
    drawer.draw(recipe(steps[3:], "three.png"), "three.png")
    drawer.draw(recipe(steps[:3], "one.png"), "one.png")
    assert ran[3:] == ["b.toml", "a.usdc", "a.toml", "a.usdc"]


def test_each_image_has_a_recipe_whose_inputs_are_there():
    found = {image.name: missing_inputs(steps) for image, (_, steps) in recipes().items() if steps}
    assert {image.name for image in recipes()} == found.keys()
    assert {name: missing for name, missing in found.items() if missing} == {}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("See [it](nowhere.md).", "leads nowhere"),
        ("See [it](usd.md#no-such-part).", "leads nowhere"),
        ("One " + "word " * 41 + "more.", "words in a sentence"),
        ("Words. " * 1600, "words, 1500 allowed"),
        ("On 2026-11-20 it was so.", "a date"),
        ("A laid coat has sub-steps.", "wrong term: laid coat"),
        ("`vary` makes it lighter.", "does not exist: vary"),
        ("A pigeon has 2,182 feathers.", "no bird has 2,182 feathers"),
        ("| size | 0.31 | 21.3 |", "figures that no command made"),
        ("Set `no_such_key`, or give `--no-such-option`.", "does not exist: --no-such-option"),
    ],
)
def test_a_page_that_breaks_a_rule_is_noticed(tmp_path, monkeypatch, text, fault):
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "docs/usd.md", tmp_path / "docs")
    page = tmp_path / "docs/page.md"
    page.write_text(text)
    monkeypatch.setattr(pages_of_docs, "ROOT", tmp_path)
    assert any(fault in each for each in faults(read_page(page), "spacing"))


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("install", "first_wing.md"),
        ("collision collide", "contact.md"),
        ("license", "README.md"),
        ("wind", "wind.md"),
        ("Houdini", "dcc.md"),
        ("Maya", "dcc.md"),
        ("Blender", "dcc.md"),
        ("farm Dask", "farm.md"),
        ("texture UDIM", "usd.md"),
        ("motion blur subframes", "usd.md"),
        ("ruffle", "direction.md"),
        ("retime", "resume.md"),
        ("sculpt", "direction.md"),
        ("wet", "hooks.md"),
        ("split", "hooks.md"),
        ("resume", "resume.md"),
        ("landmarks", "first_bird.md"),
        ("level of detail", "detail.md"),
        ("accuracy error", "error.md"),
        ("Alembic glTF", "export.md"),
        ("melanin film colours", "colours.md"),
    ],
)
def test_a_search_word_leads_to_its_page(word, page):
    """Ranked as the site's search does it, by words in title, headings and text (tf-idf)."""
    assert page in best_pages(word)[:3]


def toml_blocks():
    """Tables that pages show, with the page's name and the block's number."""
    for path in sorted((ROOT / "docs").glob("*.md")):
        blocks = re.findall(r"^```toml\n(.*?)^```", path.read_text(encoding="utf-8"), re.S | re.M)
        for number, block in enumerate(blocks):
            yield pytest.param(block, id=f"{path.stem}-{number}")


@pytest.mark.parametrize("block", list(toml_blocks()))
def test_keys_on_the_pages_exist_and_have_allowed_values(block):
    def wrong(table):
        problems = Problems()
        table.check(tomllib.loads(block), Place("page", "", problems), True)
        # a page shows parts of tables
        return [str(each) for each in problems.listed() if ": missing, expects" not in str(each)]

    tables = (GROOM_FILE, SHOT_FILE, FLOCK_FILE, Table(PRESET_FAMILIES["feather"].keys, "feather"))
    assert not min(map(wrong, tables), key=len)


def test_commands_of_pages_have_arguments_and_options_that_exist(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    count = 0
    for page, commands in pages_with_commands().items():
        for command in commands:
            words = shlex.split(command)
            for word in words[2:] if words[0] == "featherfx" else ():
                if re.fullmatch(r"[\w/.]+\.\w+", word):
                    Path(tmp_path / word.lstrip("/")).parent.mkdir(parents=True, exist_ok=True)
                    Path(tmp_path / word.lstrip("/")).touch()
                elif word.endswith("presets"):
                    Path(tmp_path / word).mkdir(exist_ok=True)
            if words[0] == "featherfx":
                try:
                    main.commands[words[1]].make_context(words[1], words[2:])
                except UsageError as error:
                    pytest.fail(f"{page}: {command}: {error.message}")
                count += 1
    assert count > 100
