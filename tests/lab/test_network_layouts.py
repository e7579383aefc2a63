"""Lattices and random networks: geometry, moduli, and the solution of their equations."""

import json

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.lab.networks.experiments import (
    NetworkPlan,
    PreconditionTest,
    _pose,
    network_moduli,
    precondition,
    sheared_system,
)
from featherfx.lab.networks.layouts import FibreSection, Mikado, mikado, triangular
from featherfx.lab.networks.network import (
    METHODS,
    PRECONDITIONERS,
    SYMMETRIC,
    network_energy,
    solve,
)

pytestmark = pytest.mark.verification
SECTION = FibreSection(1.0, 1e-4)


def test_whole_lattice_has_the_moduli_of_springs():
    """sqrt(3) / 4 and 2 / sqrt(3), 1/3: every node keeps its neighbours' symmetry."""
    for size in (4, 10):
        found = network_moduli(NetworkPlan(size=size).layout(periodic=True))
        assert found.shear_modulus == pytest.approx(np.sqrt(3) / 4, rel=1e-9)
        assert found.young_modulus == pytest.approx(2 / np.sqrt(3), rel=1e-9)
        assert found.poisson == pytest.approx(1 / 3, rel=1e-9)
        assert found.affinity == pytest.approx(1.0, rel=1e-9)


def test_segments_join_the_nodes_that_their_vectors_say():
    for layout in (
        triangular(6, 5, SECTION, "no"),
        mikado(Mikado(40, 2.0, periodic=False), SECTION),
    ):
        ends, places = layout.network.ends, layout.places
        assert places[ends[:, 1]] - places[ends[:, 0]] == pytest.approx(layout.network.span)
    layout = mikado(Mikado(100, 3.0), SECTION)
    ends, places = layout.network.ends, layout.places
    whole = (places[ends[:, 1]] - places[ends[:, 0]] - layout.network.span) / 3.0
    assert whole == pytest.approx(np.round(whole), abs=1e-12)
    # bend triplets follow each other on a straight fibre
    first, second = layout.network.pairs.T
    assert np.array_equal(ends[first, 1], ends[second, 0])
    span = layout.network.span
    turn = span[first, 0] * span[second, 1] - span[first, 1] * span[second, 0]
    assert turn == pytest.approx(0.0, abs=1e-12)


def test_crossings_are_those_of_every_pair():
    """Beside a search over all pairs of end points, by the signs of areas."""
    plan = Mikado(60, 2.5, seed=3, periodic=False)
    drawn = np.random.default_rng(plan.seed).random((plan.fibres, 3))
    along = np.exp(1j * np.pi * drawn[:, 2])
    middle = 2.5 * (drawn[:, 0] + 1j * drawn[:, 1])
    start, end = middle - 0.5 * along, middle + 0.5 * along

    def side(a, b, c):
        return np.sign(((b - a).conjugate() * (c - a)).imag)

    count = 0
    for i in range(plan.fibres):
        for j in range(i):
            across = side(start[i], end[i], start[j]) != side(start[i], end[i], end[j])
            if across and side(start[j], end[j], start[i]) != side(start[j], end[j], end[i]):
                share = ((start[i] - start[j]).conjugate() * along[j]).imag
                share /= (along[i].conjugate() * along[j]).imag
                place = start[i] - share * along[i]
                count += 0 <= place.real <= 2.5 and 0 <= place.imag <= 2.5
    layout = mikado(plan, SECTION)
    assert len(layout.places) - len(layout.held) == count
    edge = layout.places[layout.held]
    assert np.minimum(np.abs(edge), np.abs(edge - 2.5)).min(axis=1) == pytest.approx(0, abs=1e-12)


def test_merging_leaves_no_short_segments_and_moves_little():
    rough, fine = (mikado(Mikado(200, 3.0, merge=each, seed=1), SECTION) for each in (0.02, 0.0))
    assert np.linalg.norm(fine.network.span, axis=1).min() < 1e-3
    short = np.linalg.norm(rough.network.span, axis=1) < 0.01
    assert np.count_nonzero(short) < 0.002 * len(short)
    assert rough.network.nodes < fine.network.nodes
    apart = np.abs(rough.places[:, None] - fine.places[None]).sum(axis=2).min(axis=1)
    assert apart.max() == 0.0


def test_dangling_ends_carry_nothing():
    layout = mikado(Mikado(60, 4.0, seed=2, periodic=False), SECTION)
    small = layout.carrying()
    assert small.network.nodes < layout.network.nodes
    assert np.array_equal(small.places[small.held], layout.places[layout.held])
    energies = []
    for each in (layout, small):
        system = sheared_system(each)
        moved = np.zeros((each.network.nodes, 2))
        moved[each.held, 0] = 0.1 * each.places[each.held, 1]
        flat = moved.ravel()
        if each is small:
            flat[system.free] = solve(system, "direct").displacements
        else:
            # mechanisms are left where they are
            flat[system.free] = np.linalg.lstsq(system.matrix.toarray(), system.right)[0]
        energies.append(network_energy(each.network, flat))
    assert energies[0] == pytest.approx(energies[1], rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_relaxed_modulus_lies_below_the_affine_and_rises_with_bending(seed):
    for plan in (NetworkPlan(size=12, dilution=0.7), NetworkPlan("mikado", fibres=120)):
        soft, stiff = (
            network_moduli(
                NetworkPlan(**(vars(plan) | {"bend": bend, "seed": seed})).layout(periodic=True)
            )
            for bend in (1e-5, 1e-3)
        )
        assert 0.0 < soft.shear_modulus < stiff.shear_modulus
        assert 0.0 < soft.affinity < stiff.affinity < 1.0


def test_a_lattice_of_springs_below_the_threshold_carries_nothing():
    found = network_moduli(NetworkPlan(size=20, dilution=0.55, bend=0.0).layout(periodic=True))
    assert found.shear_modulus == found.young_modulus == 0.0
    assert network_moduli(NetworkPlan(dilution=0.0).layout(periodic=True)).nodes == 0


@pytest.mark.parametrize("lattice", ["triangular", "mikado"])
def test_every_method_and_preconditioner_finds_the_direct_solution(lattice):
    system = sheared_system(
        NetworkPlan(lattice, size=8, fibres=40, merge=0.1, bend=1e-3).layout(periodic=False)
    )
    direct = solve(system, "direct")
    assert direct.residual < 1e-12
    for method in METHODS[:3]:
        for choice in PRECONDITIONERS if method == "gmres" else SYMMETRIC:
            found = solve(system, method, choice, 1e-12)
            error = np.abs(found.displacements - direct.displacements).max()
            assert error < 1e-5 * np.abs(direct.displacements).max(), (method, choice)
            if choice == "P_AS":
                # P^-1 H - 1 is nilpotent of order two
                assert found.iterations <= 2


@pytest.mark.parametrize(
    ("size", "unknowns", "jacobi", "blocks"), [(6, 48, 37, 18), (12, 240, 79, 22)]
)
def test_iterations_are_those_published(size, unknowns, jacobi, blocks):
    """Houghton 2020, table 5.4."""
    for choice, count in (("P_J", jacobi), ("P_Db", blocks)):
        found = precondition(PreconditionTest(NetworkPlan(size=size), "pcg", choice))
        assert found.unknowns == unknowns
        assert found.iterations == pytest.approx(count, abs=1)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("network", "--size", "7"), "size: 7"),
        (("network", "--dilution", "1.2"), "dilution: 1.2"),
        (("network", "--lattice", "mikado", "--dilution", "0.5"), "dilution: 0.5"),
        (("network", "--lattice", "mikado", "--fibres", "50"), "density: 25"),
        (("precondition", "--method", "minres", "--preconditioner", "P_AS"), "preconditioner"),
        (("precondition", "--size", "2"), "no node is free"),
        (("precondition", "--size", "90", "--method", "gmres", "--preconditioner", "P_S"), "P_S"),
        (("precondition", "--size", "20", "--dilution", "0.5", "--bend", "0"), "mechanism"),
    ],
)
def test_bad_input_is_named(arguments, key):
    result = invoke("lab", *arguments)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert key in result.stderr


def test_commands_give_their_keys():
    result = invoke("lab", "network", "--lattice", "mikado", "--fibres", "120", "--json")
    found = json.loads(result.stdout)
    assert {"shear_modulus", "young_modulus", "affinity", "nodes"} <= set(found)
    assert found == json.loads(json.dumps(found))
    options = ("--size", "12", "--bend", "2.5e-5", "--method", "gmres", "--preconditioner", "P_Ab")
    result = invoke("lab", "precondition", *options, "--tolerance", "1e-8", "--json")
    found = json.loads(result.stdout)
    assert {"iterations", "seconds", "unknowns", "residual"} <= set(found)
    assert found["residual"] <= 1e-8
    assert "displacements" not in found


def test_plans_check_themselves():
    with pytest.raises(InputError, match="bend"):
        NetworkPlan(bend=-1.0).layout(periodic=True)


def test_large_strain_has_forces_that_are_the_energys_slopes():
    layout = triangular(6, 6, FibreSection(1.0, 1e-2), "x", 0.8, 1).carrying()
    random = np.random.default_rng(0)
    moved, way = random.normal(size=(2, 2 * layout.network.nodes))
    errors = []
    for step in (1e-3, 5e-4):
        ahead, behind = (_pose(layout, 0.05 * moved + s * step * way).energy for s in (1, -1))
        errors.append(
            abs((ahead - behind) / (2.0 * step) - _pose(layout, 0.05 * moved).gradient @ way)
        )
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_scattered_fibres_lie_about_the_x_axis():
    layout = mikado(Mikado(2000, 9.0, seed=4, scatter=0.2), SECTION)
    span = layout.network.span
    angle = np.arctan2(span[:, 1], span[:, 0])
    angle = (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    # fibres that lie across others have more segments, which widens it
    assert 0.15 < angle.std() < 0.35
    with pytest.raises(InputError, match="scatter"):
        NetworkPlan("triangular", scatter=10.0).layout(periodic=True)
