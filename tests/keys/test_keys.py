"""Every declared key does something: another value of it is seen in what a bake writes or says."""

import pytest
from assets import write_assets
from changes import bake, declared_keys, keys_in, other_values, value_at, with_value
from scenes import ELSEWHERE, LABELS, SCENES

from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.shot.read.keys import SHOT_FILE


def tried_keys(scene):
    """(file, path, key) of the keys that a scene tries."""
    for file, kind in (("groom", GROOM_FILE), ("shot", SHOT_FILE)):
        raw = getattr(scene, file)
        for path, key in keys_in(kind, raw):
            name = ".".join(map(str, (file, *path)))
            value = value_at(raw, path, None)
            inner = value in ({}, []) or isinstance(value, dict) or holds_tables(value)
            if name.startswith(scene.tries) and not inner and not left(scene, name):
                yield file, path, key, name


def left(scene, name):
    """Whether another scene shows a key."""
    return any(name.endswith(end) or f"{end}." in name for end in scene.leaves)


def holds_tables(value):
    """Whether the keys of its tables stand for it."""
    return isinstance(value, list) and any(isinstance(each, dict) for each in value)


def candidates(scene, path, key, name):
    """Other values of a key."""
    for end, values in scene.values.items():
        if name.endswith(end):
            return values
    return other_values(key.type, value_at_file(scene, name, path, key))


def value_at_file(scene, name, path, key):
    return value_at(getattr(scene, name.partition(".")[0]), path, key.default)


# the wing's take as long as all of ten others'
LONG = {"wing"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.nightly] * (n in LONG)) for n in SCENES]
)
def test_every_key_of_a_scene_is_noticed(tmp_path, name):
    write_assets(tmp_path)
    scene = SCENES[name]
    usual = bake(tmp_path, scene.groom, scene.shot, **scene.options)
    assert usual is not None
    silent, found = [], None
    for file, path, key, full in tried_keys(scene):
        files = {"groom": scene.groom, "shot": scene.shot}
        for value in candidates(scene, path, key, full):
            changed = files | {file: with_value(files[file], path, value)}
            found = bake(tmp_path, changed["groom"], changed["shot"], **scene.options)
            if found not in (None, usual):
                break
        else:
            silent.append(full if found else f"{full} (refused)")
    assert silent == []


def used_keys(scene):
    """Name and meaning of the tables that a scene holds, whose keys stand for them."""
    for file, kind in (("groom", GROOM_FILE), ("shot", SHOT_FILE)):
        raw = getattr(scene, file)
        for path, key in keys_in(kind, raw):
            value = value_at(raw, path, None)
            if isinstance(value, dict) or holds_tables(value):
                yield path[-1], key.meaning


def test_every_declared_key_is_tried():
    tried = {(path[-1], key.meaning) for s in SCENES.values() for _, path, key, _ in tried_keys(s)}
    tried |= {each for scene in SCENES.values() for each in used_keys(scene)}
    missing = [path for key, path in declared_keys().items() if key not in tried]
    others = (*ELSEWHERE, *LABELS)
    assert [each for each in missing if not any(other in each for other in others)] == []
