"""Figures of a vane's air that are one number, or one for each vane."""

from __future__ import annotations

from dataclasses import replace

import pytest
from trial_batches import preset_kind

from featherfx.feather.shapes import decode_shape, encode_shape
from featherfx.groom.presets.kinds import blended

KIND = preset_kind("swan_primary")


def with_permeability(own):
    return replace(KIND, vane_material=replace(KIND.vane_material, permeability=own))


def test_one_number_is_blended_with_one_for_each_vane():
    first, second = with_permeability(0.1), with_permeability((0.5, 0.9))
    for one, other in ((first, second), (second, first)):
        found = blended(one, other, 0.5).vane_material.permeability
        assert found == pytest.approx((0.3, 0.5))
    assert blended(first, first, 0.5).vane_material.permeability == pytest.approx(0.1)


@pytest.mark.parametrize("own", [0.0, 0.25, (0.5, 0.9)])
def test_a_text_of_a_shape_keeps_either(own):
    kind = with_permeability(own)
    assert decode_shape(encode_shape(kind, True))[0].vane_material == kind.vane_material


@pytest.mark.parametrize("own", ['"thin"', "true", '[0.1, "thin"]', "null"])
def test_a_text_with_something_else_is_refused(own):
    text = encode_shape(with_permeability(0.25), False)
    with pytest.raises(ValueError, match=r"holds|is no shape"):
        decode_shape(text.replace('"permeability":0.25', f'"permeability":{own}'))
