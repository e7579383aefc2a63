"""What is left out of a page that is to be small, and coarser versions of what is in it."""

from __future__ import annotations

import numpy as np
from test_view_page import EVERYTHING

from featherfx.view.page import fitting
from featherfx.view.played import Played


def test_what_does_not_fit_is_left_out_and_told(cache):
    whole = fitting(cache, EVERYTHING)
    assert whole.told() == []
    some = fitting(cache, 5 * whole.frame_bytes - 1)
    assert some.points < whole.points
    assert "without the tubes of rachises" in some.told()[0]
    least = fitting(cache, 900)
    assert len(least.codes) < 5
    assert least.codes[0] == 1.0
    assert "rows and one barb segment" in least.told()[0]
    assert "every" in least.told()[1]
    # points that are kept stand where the cache has them
    header = least.header()
    assert header["framesPerSecond"] < 24.0
    firsts = [each["first"] for each in header["feathers"]]
    assert firsts == sorted(set(firsts))
    assert np.frombuffer(least.constant(), "<u4", 3 * header["triangles"]).max() < least.points


def test_levels_have_ever_fewer_of_the_points(cache):
    for most in (EVERYTHING, 40):
        played = Played(cache, most)
        header = played.header()
        counts = np.array([[header["points"], header["triangles"]], *header["levels"]])
        assert len(counts) == 1 + played.levels > 1
        assert (np.diff(counts, axis=0) < 0).all()
        words = np.frombuffer(played.constant()[: -9 * played.points], "<u4")
        words = words[3 * header["triangles"] :]
        whole = np.frombuffer(played.frame(2), "<u2", 3 * played.points, 24).reshape(-1, 3)
        box = np.frombuffer(played.frame(2), "<f4", 6)
        for level, (points, triangles) in enumerate(header["levels"], 1):
            chosen, corners = words[:points], words[points : points + 3 * triangles]
            words = words[points + 3 * triangles :]
            assert (np.diff(chosen.astype(int)) > 0).all()
            assert set(corners) == set(range(points))
            frame = played.frame(2, level)
            own = np.frombuffer(frame, "<f4", 6)
            places = np.frombuffer(frame, "<u2", 3 * points, 24).reshape(-1, 3)
            found, wanted = own[:3] + places / 65535 * own[3:], box[:3] + whole / 65535 * box[3:]
            np.testing.assert_allclose(found, wanted[chosen], atol=2 * box[3:].max() / 65535)
        assert len(words) == 0
