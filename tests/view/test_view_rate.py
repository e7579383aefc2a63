"""A whole bird plays in a browser without a graphics card."""

import pytest
from page_rate import PLAIN, PLAY, measure
from places import SAMPLES
from test_view_page import needs_browser

from featherfx import bake
from featherfx.view.page import Server, fitting_second


@needs_browser
@pytest.mark.nightly
def test_a_bird_plays_at_ten_frames_a_second_on_one_core(tmp_path):
    """By processor time of server and browser, since other work may keep the machine busy."""
    cache = bake(SAMPLES / "first_bird/shot.toml", tmp_path / "bird.usdc", frames=(1, 6))
    assert len(cache) == 2956
    played = fitting_second(cache.path, 64_000_000)
    rate, milliseconds = measure(lambda: Server(played), PLAY, "playing", PLAIN)
    assert rate > 0.0
    assert milliseconds < 100.0
