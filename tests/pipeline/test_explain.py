"""Explained options: they are those that the solver is given, and name their sources."""

from __future__ import annotations

import json

import pytest
from commands import invoke
from places import SAMPLES

from featherfx.api import read_shot
from featherfx.baking.check import explain_options, explained_lines
from featherfx.shot.loop.simulate import simulate

OPTIONS = (
    "level",
    "rows",
    "columns",
    "coefficients",
    "tolerance",
    "newton_tolerance",
    "max_substeps",
    "spectral_radius",
)


def shot_file(folder, text, name="swan_wing"):
    """A shot of a sample's groom with some lines of its own."""
    groom = SAMPLES / name / "groom.toml"
    path = folder / "shot.toml"
    path.write_text(f'name = "s"\ngroom = "{groom}"\nframes = [1, 2]\n{text}\n')
    return path


@pytest.mark.parametrize(
    "sample",
    ["swan_wing/shot.toml", pytest.param("pigeon/contact.toml", marks=pytest.mark.nightly)],
)
def test_explained_options_are_those_that_the_solver_is_given(sample):
    path = SAMPLES / sample
    (found, _), simulation = explain_options(path), simulate(read_shot(path))
    placements = simulation.shot.groom.feathers
    assert list(found) == [placement.id for placement in placements]
    for group in simulation._run.groups:
        settings, names = group.solver.settings, [placements[f].id for f in group.members]
        for name in names:
            own = {option: each["value"] for option, each in found[name].items()}
            assert (own["rows"], own["columns"]) == (
                group.feathers[0].rows,
                group.solver.model.columns,
            )
            assert own["coefficients"] == group.state.coefficient.shape[3] // 2
            assert own["tolerance"] == settings.tolerance
            assert own["newton_tolerance"] == settings.newton
            assert own["max_substeps"] == settings.max_substeps
            assert own["spectral_radius"] == settings.spectral_radius
            assert own["level"] == group.level
    for group in simulation._run.step_groups:
        if hasattr(group, "contact"):
            gaps = [found[name]["contact_tolerance"]["value"] for name in group.contact.names]
            assert group.contact.solver.settings.tolerance == min(gaps)


def test_each_value_names_its_source(tmp_path):
    text = 'quality = { base = "draft", simulated_rows = 7, max_substeps = 300 }\n'
    text += '[[detail]]\nfeathers = "*_02"\nlevel = "coarse"\n'
    text += '[[detail]]\nfeathers = "right_primary_02"\nlevel = "rigid"\n'
    found, _ = explain_options(shot_file(tmp_path, text))
    own = found["right_primary_01"]
    assert own["rows"] == {"value": 7, "from": "quality.simulated_rows"}
    assert own["max_substeps"] == {"value": 300, "from": "quality.max_substeps"}
    assert own["coefficients"]["from"] == own["columns"]["from"]
    assert own["columns"]["from"] == "measured for an error of 3 % (quality preset draft)"
    assert own["level"] == {"value": "full", "from": "default"}
    assert found["left_primary_02"]["level"] == {"value": "coarse", "from": "[[detail]] 1"}
    assert found["right_primary_02"]["level"] == {"value": "rigid", "from": "[[detail]] 2"}


def test_feathers_alike_share_a_line_and_one_feather_has_a_line_for_each_option(tmp_path):
    path = shot_file(tmp_path, 'quality = { base = "draft", tolerance = 1e-4 }')
    told = invoke("check", "--explain", path)
    assert told.exit_code == 0
    assert told.stdout.splitlines() == list(explained_lines(*explain_options(path)))
    assert told.stdout.startswith("20 feathers (")
    alone = "check", "--explain", path, "--feather", "right_primary_01"
    told = invoke(*alone)
    assert "  tolerance 0.0001 m (quality.tolerance)" in told.stdout.splitlines()
    whole = json.loads(invoke(*alone, "--json").stdout)
    assert set(OPTIONS) <= set(whole["feathers"]["right_primary_01"])
    assert invoke(*alone[:-1], "nobody").exit_code != 0
