"""The error that is estimated of a shot, beside that against a much finer simulation."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES

from featherfx.api import read_shot
from featherfx.baking.accuracy import _AT_FIRST, _PARTS, chosen_feathers, own_grids, shot_error
from featherfx.errors import InputWarning
from featherfx.feather.density import density_map
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.types import part_of


def sample(name, frames=None):
    shot = replace(read_shot(SAMPLES / name / "shot.toml"), contact=None)
    last = shot.last_frame if frames is None else shot.first_frame + frames - 1
    return replace(shot, last_frame=last)


def true_error(shot, feathers):
    """Largest distance, m, of the nodes of a few feathers from a simulation with four times the
    rows and columns, four coefficients more, and steps of a 256th of the tolerance."""
    chosen = chosen_feathers(shot, feathers)
    given = simulate(shot, 2, wanted=chosen.tolist())
    frames = list(given)
    worst = 0.0
    for k, grid in enumerate(own_grids(shot, given.options, chosen)):
        quality = replace(
            shot.quality,
            rows=4 * (grid.rows - 1) + 1,
            columns=4 * grid.columns,
            coefficients=min(6, grid.coefficients + 4),
            simulated_rows=0,
            error=None,
            tolerance=grid.tolerance / 256,
            max_substeps=4096,
            coarse_below=0.0,
            rachis_below=0.0,
            guided_below=0.0,
            rigid_below=0.0,
        )
        part = part_of(shot, chosen[k : k + 1])
        fine = simulate(replace(part, quality=quality, details=(), level_of_detail=None), 2)
        to_given = density_map(fine.feathers[0], given.feathers[k])
        for frame, reference in zip(frames, fine, strict=True):
            wanted = to_given(reference.poses[0].points).nodes
            way = np.linalg.norm(frame.poses[k].points.nodes - wanted, axis=-1)
            worst = max(worst, float(way.max()))
    return worst


def test_pulled_feather_errs_as_estimated():
    shot = sample("feather_pull", 4)
    found = shot_error(shot, jobs=2)
    true = 1e3 * true_error(shot, 1)
    assert 0.5 * true < found.error_mm < 2.0 * true
    assert set(found.parts) == set(_PARTS) - {"all"}
    assert found.feathers == ("feather",)
    assert max(each.mm for each in found.parts.values()) < 2.0 * found.error_mm


@pytest.mark.slow
def test_a_lone_feather_touches_colliders_in_the_error():
    """The post of the torn feather reaches it in the fourth to sixth frame; nothing else moves."""
    shot = read_shot(SAMPLES / "torn_feather" / "shot.toml")
    shot = replace(shot, last_frame=shot.first_frame + 5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        found = shot_error(shot, jobs=2)
    true = 1e3 * true_error(shot, 1)
    assert found.contact
    assert true > 0.1
    assert 0.5 * true < found.error_mm < 2.0 * true


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(each.name for each in SAMPLES.iterdir()))
def test_samples_err_as_estimated(name):
    shot = sample(name, 8)
    found, true = shot_error(shot, jobs=2), 1e3 * true_error(shot, 4)
    # nothing moves the torn feather but what it touches
    nothing = 1e-6
    assert 0.5 * true - nothing < found.error_mm < 2.0 * true + nothing
    # ends of its barbs flutter on 81 rows and more
    assert (_AT_FIRST in found.parts) >= (name == "wet_feather")


def test_feathers_that_are_pulled_or_bend_most_are_chosen():
    shot = sample("swan_wing", 2)
    lengths = [each.kind.length for each in shot.groom.feathers]
    chosen = chosen_feathers(shot, 3)
    assert len(chosen) == 3 == len(set(chosen))
    assert int(np.argmax(lengths)) in chosen
    every = chosen_feathers(shot, 1000)
    assert np.array_equal(every, np.arange(len(lengths)))


def test_command_gives_its_keys(tmp_path):
    groom = (SAMPLES / "feather_pull" / "groom.toml").as_posix()
    text = f'name = "x"\ngroom = "{groom}"\nframes = [1, 2]\nmotion = "hold"\nwind = "breeze"\n'
    shot = tmp_path / "shot.toml"
    shot.write_text(text + 'quality = "draft"\n')
    result = invoke("error", shot, "--json", "--progress", "json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["error_mm"] > 0.0
    assert found["error_percent"] > 0.0
    assert {"rows", "columns", "coefficients", "time"} <= set(found["parts"])
    assert '"comparing"' in result.stderr
    result = invoke("error", groom)
    assert result.exit_code == 1
    assert "expects a shot" in result.stderr
