"""The table of skipped work: its lines, and that it sees what a skip does."""

from dataclasses import replace

import pytest
from commands import invoke
from places import SAMPLES

from featherfx.lab.bench.skips import SKIPS, skips_table
from featherfx.shot.read.read import read_shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"


def short():
    shot = read_shot(SAMPLE)
    quality = replace(shot.quality.pushing, rows=9, columns=3, coefficients=1)
    return replace(shot, quality=quality, last_frame=shot.first_frame + 5)


def test_every_skip_has_a_line_with_its_error():
    seen = []
    table = skips_table([short()], lambda done, total: seen.append((done, total)))
    lines = {row["skip"]: row for row in table.rows}
    # the tip is gripped, so it cannot be rigid; one feather has no guides
    left_out = {"detail rigid", "detail guided", "levels by size in the image"}
    assert list(lines) == [skip.name for skip in SKIPS if skip.name not in left_out]
    assert seen[-1] == (len(lines), len(lines))
    assert lines["detail coarse"]["error added %"] > 0.0
    assert lines["detail rachis"]["grids"] == "6x1x0"
    sleeping = lines["feathers at rest sleep"]
    assert sleeping["skipped feather frames"] >= 3
    assert sleeping["error added %"] < 1e-3


@pytest.mark.slow
def test_guides_and_cameras_are_measured_on_wings():
    wing = read_shot(SAMPLE.parents[1] / "swan_wing" / "shot.toml")
    for only, frames in (("detail guided", 3), ("levels*", 24)):
        (row,) = skips_table([wing], lambda done, total: None, only, frames).rows
        assert 0.0 < row["mean error %"] < row["error added %"] < 20.0


def test_a_shot_that_is_not_there_is_wrong_usage():
    result = invoke("bench", "--skips", "nowhere.toml")
    assert result.exit_code == 2
    assert "nowhere.toml" in result.output
