"""Vane samples of stiff and soft bands: closed forms, table 5.1, bending, size effect."""

import numpy as np
import pytest

from featherfx.cli.program import plain
from featherfx.errors import InputError
from featherfx.lab.declare import out_of_range
from featherfx.lab.vane.mesoscale import (
    Bands,
    SwanBands,
    band_mesh,
    band_width,
    fit_shear,
    pull_bands,
    run_size_effect,
    tilted_sample,
    transverse_stress,
    whole_periods,
)
from featherfx.lab.vane.sample import (
    Moduli,
    Sample,
    aligned_mesh,
    corner_rows,
    isotropic,
    membrane,
    strains,
)
from featherfx.lab.vane.statics import Statics
from featherfx.lab.vane.traction import Traction, clamped, pull_test, run_locking

BANDS = SwanBands(0.14, 5e-4).bands()


@pytest.mark.verification
def test_transverse_bands():
    """Jouve 2024, eq. 5.4, (P - l)((P - l)^2 - (P - 1)^2) / (2 l (P - 1)^3) E_b: rigid barbs."""
    sample = whole_periods(Sample(0.0, 3e-3, 4e-3), BANDS)
    strain = strains(0.4, 4)
    found = pull_bands(sample, BANDS, strain).stress
    share, whole = BANDS.barb_fraction, np.sqrt(1.0 + 2.0 * strain)
    cube = (share - whole) * ((share - whole) ** 2 - (share - 1.0) ** 2)
    published = BANDS.barbule * cube / (2.0 * whole * (share - 1.0) ** 3)
    assert found == pytest.approx(published, rel=1e-4)
    assert transverse_stress(BANDS, strain) == pytest.approx(published, rel=1e-12)
    assert found == pytest.approx(transverse_stress(BANDS, strain, rigid=False), rel=1e-8)


@pytest.mark.verification
def test_one_layer_of_six_node_triangles_bends_as_a_beam():
    """A bar clamped at both ends, one end pushed sideways: F = E w^3 b d / L^3 (12 E I / L^3),
    with the shear of a Timoshenko beam: 12 E I / (G k A L^2) = 2.4 w^2 / L^2, G = E/2, k = 5/6.
    """
    length, width, modulus, push = 10e-3, 0.5e-3, 1e9, 1e-7
    sample = Sample(90.0, width, length)
    mesh = aligned_mesh(sample, np.array([-width, 0.0]), 0.4e-3)
    body = membrane(sample, mesh, isotropic(modulus).as_array(), 2)
    top = body.points[:, 1] >= length
    statics = Statics(body, top | (body.points[:, 1] <= 0.0))
    pose = statics.move(statics.rest(), body.points + np.outer(top, [push, 0.0]))
    force = statics.forces(pose)[top, 0].sum()
    beam = modulus * width**3 * sample.thickness * push / length**3
    beam /= 1.0 + 2.4 * width**2 / length**2
    assert force == pytest.approx(beam, rel=0.01)


def test_bands_have_their_share_of_the_surface():
    sample = Sample(45.0, 8e-3, 11e-3)
    mesh, moduli = band_mesh(sample, BANDS)
    corner = mesh.points[mesh.triangles]
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    stiff = moduli[:, 0] == BANDS.barb
    assert area[stiff].sum() / area.sum() == pytest.approx(0.14, abs=0.01)
    assert area.sum() == pytest.approx(8e-3 * 11e-3, rel=1e-8)


@pytest.mark.slow
def test_shear_of_the_membrane_is_that_of_the_bands():
    """The fit gives the bands' slope; at small spacing bands shear as in series (within 5 %)."""
    found = fit_shear(SwanBands(0.14, 1e-3).bands())
    assert found.slope == pytest.approx(found.bands_slope, rel=1e-4)
    assert 0.8 < found.moduli.shear / found.series < 1.1


def test_long_triangles_of_three_nodes_are_too_stiff():
    sample, strain = tilted_sample(45.0, 9e-3), np.array([0.02])
    slopes = [pull_bands(sample, BANDS, strain, each).slope for each in (0.0, 2e-4, 4e-4)]
    assert slopes[2] > 1.1 * slopes[1] > 1.2 * slopes[0]


def test_shear_band_lies_between_the_corners_barbs():
    widths = []
    for aspect in (1.4, 2.0):
        sample = tilted_sample(45.0, 9e-3, aspect)
        pulled = pull_test(Traction(sample, Moduli(3.6e8, 4.8e4, 2.3e4), 0.02, 1, 1500))
        widths.append(band_width(sample, pulled))
        corners = (sample.height - sample.width) * np.sqrt(0.5)
        assert widths[-1] == pytest.approx(corners, rel=0.12)
    assert widths[1] > 1.8 * widths[0]


def test_stress_in_compression_is_quadratic_in_the_width():
    found = run_size_effect((6, 8, 10))
    assert found.unexplained < 0.01
    assert found.quadratic < 0.0
    assert np.all(np.diff(-found.stress_over_barb_modulus[:, -1]) < 0.0)
    # far below even compression: the barbs give way by bending
    assert -found.stress_over_barb_modulus.min() < 0.1 * 0.14 * 0.03


def test_locking_study():
    found = run_locking((1.0, 1e4), (128, 512), 4000)
    assert found.error("aligned", 1e4)[-1][1] < 0.03
    assert found.error("unaligned", 1e4)[0][1] > 10.0
    assert found.error("unaligned", 1.0)[0][1] < 1e-2
    assert found.error("aligned", np.inf)[-1][1] < 0.03
    values = plain(found)
    assert {point["mesh"] for point in values["points"]} == {"aligned", "unaligned"}
    with pytest.raises(InputError, match="ratio"):
        run_locking((0.5,))


def test_bands_out_of_range():
    wrong = Bands(1.2, 0.5, 0.0, np.nan)
    keys = [problem.key for problem in out_of_range(wrong)]
    assert keys == ["barb_fraction", "barb_spacing", "barb", "barbule"]
    with pytest.raises(InputError):
        run_size_effect((2, 8, 12))


def test_barbs_that_bend_within_the_plane_resist_as_clamped_beams():
    """12 S b W / H^3 for clamps that part sideways, S the bending stiffness of an area."""
    sample = Sample(90.0, 8e-3, 10e-3)
    low, *_, high = corner_rows(sample)
    mesh = aligned_mesh(sample, np.linspace(low, high, 7), 0.5e-3)
    stiffness = 3.0e-4
    body = membrane(sample, mesh, np.ones(3), barb_bending=stiffness)
    form = body.bending.toarray()[::2, ::2]
    held = clamped(sample, body)
    moved = 1e-4 * (body.points[:, 1] >= sample.height)
    load = -(form[~held] @ moved)
    moved[~held] = np.linalg.solve(form[np.ix_(~held, ~held)], load)
    wanted = 12.0 * stiffness * sample.thickness * sample.width / sample.height**3 * 1e-4**2
    assert moved @ form @ moved == pytest.approx(wanted, rel=5e-3)
    # moving as a whole is no bending
    assert np.abs(form @ np.ones(len(form))).max() < 1e-9 * np.abs(form).max()
