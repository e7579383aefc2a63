"""A vane as a lattice of barbs and barbules."""

from dataclasses import replace

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.groom.presets.presets import load_preset
from featherfx.lab.feather import feather_kind
from featherfx.lab.networks.unit_cell import cell_moduli, cell_of, vane_of, vane_text

KIND = feather_kind("swan_primary")
CELL = cell_of(KIND)


def test_barbs_alone_carry_along_and_bend_along():
    vane, found = KIND.vane_material, cell_moduli(CELL)
    assert found.along == pytest.approx(vane.modulus_along_barbs, rel=1e-3)
    assert found.bending_along == pytest.approx(vane.barb_bending_normal, rel=1e-3)
    assert found.poisson == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("hooks", [1, 3])
def test_barbules_bend(hooks):
    """Bending goes with the fourth power of the diameter; stretch would go with the second."""
    moduli = [
        cell_moduli(replace(CELL, hooks=hooks, barbule_diameter=each)).across
        for each in (2e-6, 2.2e-6)
    ]
    assert np.log(moduli[1] / moduli[0]) / np.log(1.1) == pytest.approx(4.0, abs=0.01)


def test_energy_lies_between_nothing_and_the_affine_bound():
    found = cell_moduli(CELL)
    assert np.linalg.eigvalsh(found.relaxed).min() > 0.0
    gap = np.linalg.eigvalsh(found.affine - found.relaxed)
    assert gap.min() > -1e-9 * np.abs(found.affine).max()


def test_saved_vane_is_a_preset(tmp_path):
    vane = vane_of(CELL, KIND.vane_material)
    folder = tmp_path / "material" / "vane"
    folder.mkdir(parents=True)
    (folder / "mine.toml").write_text(vane_text(vane, "swan_primary"))
    family, tree = load_preset("mine", (tmp_path,))
    assert family == "material/vane"
    assert tree["modulus_across_barbs"].value == pytest.approx(vane.modulus_across_barbs)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"angle": 95.0}, "angle"),
        ({"barbule_spacing": 1.0}, "barbule_spacing"),
        ({"barbule_spacing": 1e-9}, "barbule_spacing"),
        ({"barbule_diameter": 0.0}, "barbule_diameter"),
        ({"hooks": 0}, "hooks"),
        ({"hooks": 99}, "hooks"),
    ],
)
def test_wrong_values(changes, key):
    with pytest.raises(InputError) as caught:
        cell_of(KIND, **changes)
    assert [problem.key for problem in caught.value.problems] == [key]
