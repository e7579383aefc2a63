"""Motions of birds go as far, and beat as often, as the body and the wings of a groom ask for."""

from dataclasses import replace

import numpy as np
import pytest
from test_bird_motions import BIRD, SHOT

from featherfx.errors import InputError
from featherfx.shot.motion.flap import PIGEON, Build, beat_of, build_of, size_of
from featherfx.shot.read.read import read_shot


def clock_of(folder, scale, motion):
    wing = f'type = "sparrow"\nscale = {scale}'
    groom = BIRD.replace('type = "sparrow"', wing)
    at = f"[{0.03 * scale}, {-0.03 * scale}, 0.03]"
    (folder / "groom.toml").write_text(groom.replace("[0.03, -0.03, 0.03]", at))
    (folder / "shot.toml").write_text(SHOT + motion)
    shot = read_shot(folder / "shot.toml")
    return shot.motion.clock, shot.groom


def test_a_pigeon_beats_as_the_presets_have_it():
    assert size_of(PIGEON) == pytest.approx(1.0)
    assert beat_of(PIGEON) == pytest.approx(1.0)


def test_birds_in_proportion_beat_as_the_root_of_their_length():
    """Pennycuick 1996: of geometrically similar birds the frequency goes as mass^(-1/6)."""
    twice = Build(8 * PIGEON.volume, 2 * PIGEON.span, 4 * PIGEON.area)
    assert size_of(twice) == pytest.approx(2.0)
    assert beat_of(twice) == pytest.approx(8 ** (-1 / 6))


def test_long_wings_of_a_light_body_beat_slower():
    """A herring gull's, by Pennycuick's formula itself, in proportion to the pigeon's."""

    def beats(mass, span, area):
        return mass**0.375 * span ** (-23 / 24) * area ** (-1 / 3)

    gull = Build(3.0 * PIGEON.volume, 2.0 * PIGEON.span, 3.2 * PIGEON.area)
    known = beats(3.0 * 0.35, 2.0 * 0.67, 3.2 * 0.063) / beats(0.35, 0.67, 0.063)
    assert beat_of(gull) == pytest.approx(known)
    assert beat_of(gull) < 0.65 * size_of(gull) ** -0.5


def test_a_motion_of_birds_is_fitted_to_the_wings_of_a_groom(tmp_path):
    small, groom = clock_of(tmp_path, 1.0, 'base = "take_off"')
    large, _ = clock_of(tmp_path, 4.0, 'base = "take_off"')
    assert small.size == pytest.approx(build_of(groom).span / PIGEON.span)
    assert large.size == pytest.approx(4.0 * small.size, rel=0.02)
    assert large.tempo == pytest.approx(0.5 * small.tempo, rel=0.02)


def test_tempo_and_size_are_factors_of_what_fits_and_fit_can_be_left_out(tmp_path):
    own, _ = clock_of(tmp_path, 1.0, 'base = "walk"')
    half, _ = clock_of(tmp_path, 1.0, 'base = "walk"\ntempo = 0.5\nsize = 3')
    assert (half.tempo, half.size) == pytest.approx((0.5 * own.tempo, 3.0 * own.size))
    assert own.tempo == pytest.approx(own.size**-0.5)
    bare, _ = clock_of(tmp_path, 1.0, 'base = "walk"\nfit = "none"\ntempo = 0.5')
    assert (bare.tempo, bare.size) == (0.5, 1.0)


def test_parts_of_an_act_are_fitted_alone(tmp_path):
    (tmp_path / "groom.toml").write_text(BIRD)
    parts = 'kind = "act"\nmotions = [{ base = "take_off" }, { base = "glide", start = 1.8 }]'
    (tmp_path / "shot.toml").write_text(SHOT + parts)
    motion = read_shot(tmp_path / "shot.toml").motion
    assert motion.clock.tempo == 1.0
    assert all(part.clock.tempo > 1.2 for part in motion.values["motions"])
    assert motion.values["motions"][1].clock.start == 1.8


def test_a_skin_tells_the_size_of_its_bird(tmp_path):
    _, groom = clock_of(tmp_path, 1.0, 'base = "walk"')
    ends = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = ends[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    build = build_of(replace(groom, skin=faces + 5.0))
    assert build.volume == pytest.approx(0.001 / 6)
    open_ = build_of(replace(groom, skin=faces[1:]))
    assert open_.volume == 0.0
    assert size_of(open_) == pytest.approx(open_.span / PIGEON.span)


def test_a_fit_that_is_none_is_told(tmp_path):
    with pytest.raises(InputError, match=r"motion.fit: 'wings' is not allowed"):
        clock_of(tmp_path, 1.0, 'base = "walk"\nfit = "wings"')
