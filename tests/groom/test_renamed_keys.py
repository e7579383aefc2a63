"""Old names of keys are errors that name the new ones, and CHANGELOG.md lists them."""

import re
from pathlib import Path

import pytest

from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.places import Named
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.renamed import REMOVED, RENAMED
from featherfx.groom.keys.values import ArrayOf, Either, Partial, Table, Tables
from featherfx.shot.read.keys import SHOT_FILE

CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"


def dotted(table, name):
    return f"{table}.{name}" if table else name


def tables_with(kind, name, path=""):
    """(dotted path, table) of all tables that have a key, below a type of value."""
    if isinstance(kind, Table):
        if name in kind.keys:
            yield path, kind
        for key, each in kind.keys.items():
            yield from tables_with(each.type, name, dotted(path, key))
    elif isinstance(kind, Tables | Partial):
        yield from tables_with(kind.table, name, path)
    elif isinstance(kind, ArrayOf | Named):
        yield from tables_with(kind.item, name, path)
    elif isinstance(kind, Either):
        for each in kind.options.values():
            yield from tables_with(each, name, path)
    elif preset := getattr(kind, "preset", kind if hasattr(kind, "extended") else None):
        yield from tables_with(preset.extended, name, path) if "motions" not in path else ()


KINDS = [SHOT_FILE, GROOM_FILE, *(each.extended for each in PRESET_FAMILIES.values())]


@pytest.mark.parametrize(("table", "old", "new"), RENAMED)
def test_an_old_key_is_an_error_that_names_the_new_one(table, old, new):
    found = [
        kind
        for each in KINDS
        for path, kind in tables_with(each, new)
        if path == table or path.endswith(f".{table}") or not path
    ]
    assert found
    for kind in found:
        assert old not in kind.keys
        problems = Problems()
        kind.check({old: 1}, Place("shot.toml", table, problems), False)
        told = [str(each) for each in problems.listed()]
        assert f"shot.toml: {dotted(table, old)}: was renamed. Write {new}." in told
        assert not any(f"{new}: missing" in each for each in told)


@pytest.mark.parametrize(("path", "advice"), REMOVED.items())
def test_a_removed_key_is_an_error_that_says_what_to_do(path, advice):
    problems = Problems()
    table, _, name = path.rpartition(".")
    Table({}).check({name: 1}, Place("shot.toml", table, problems), False)
    assert [str(each) for each in problems.listed()] == [
        f"shot.toml: {path}: was removed. {advice}"
    ]


def test_the_changelog_lists_the_same_keys():
    text = CHANGELOG.read_text(encoding="utf-8")
    listed = re.findall(r"^(\S+) -> (\S+)$", text.partition("## Renamed keys")[2], re.MULTILINE)
    assert listed == [(dotted(t, old), dotted(t, new)) for t, old, new in RENAMED]
    removed = re.findall(r"^(\S+): ", text.partition("## Removed keys")[2], re.MULTILINE)
    assert removed == list(REMOVED)
