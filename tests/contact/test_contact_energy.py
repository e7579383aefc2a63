"""The energy of contact with planes: derivatives, and what its force is where it is known."""

from __future__ import annotations

import numpy as np
import pytest
from derivatives import derivative_fault, unnoticed_signs

from featherfx.mechanics.contact_kernels import (
    add_contact_forces,
    add_contact_stiffness,
    contact_energy,
    friction_potential,
    press,
)
from featherfx.mechanics.model import Contacts

ROWS, POINTS, SHARE = 3, 7, 0.4


def random_contacts(rng, count=8):
    """Contacts of feather 1 of two, none of feather 0; half of them press, all but two rub."""
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    node = np.stack([rng.integers(0, ROWS, count), rng.choice([0, 3, 4, 5, 6], count)], axis=1)
    strength = rng.uniform(0.5, 2.0, size=(count, 4))
    strength[:2, 2] = 0.0
    strength[:, 3] = rng.choice([0.1, 3.0], count)
    return Contacts(
        first=np.array([0, 0, count]),
        node=node,
        normal=normal,
        offset=rng.normal(size=(count, 2)),
        target=rng.normal(size=(count, 2, 3)),
        strength=strength,
    )


def derivatives(contacts, points):
    force, stiff = np.zeros((ROWS, POINTS, 3)), np.zeros((ROWS, POINTS, 6))
    add_contact_forces(contacts, 1, SHARE, points, force)
    for c in range(contacts.first[1], contacts.first[2]):
        presses = press(contacts, c, SHARE, points) > 0.0
        add_contact_stiffness(contacts, c, presses, SHARE, points, stiff)
    return force, stiff


@pytest.mark.parametrize("seed", range(6))
def test_the_force_is_the_gradient_of_the_energy(seed):
    rng = np.random.default_rng(seed)
    contacts, points = random_contacts(rng), rng.normal(size=(ROWS, POINTS, 3))
    gradient = derivatives(contacts, points)[0].ravel()

    def value(x):
        return contact_energy(contacts, 1, SHARE, points + x.reshape(points.shape))

    def fault(slopes):
        # the energy is C1 where a contact closes, so the order need not show
        return derivative_fault(value, slopes, rng, scale=1e-3, curved=False)

    assert fault(gradient) == ""
    assert unnoticed_signs(fault, gradient) == []
    assert contact_energy(contacts, 0, SHARE, points) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_the_stiffness_is_the_derivative_of_the_force_and_never_negative(seed):
    rng = np.random.default_rng(seed)
    contacts, points = random_contacts(rng), rng.normal(size=(ROWS, POINTS, 3))
    stiff = derivatives(contacts, points)[1]
    step = 1e-6
    for i in range(ROWS):
        for p in range(POINTS):
            xx, yy, zz, xy, xz, yz = stiff[i, p]
            told = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            found = np.zeros((3, 3))
            for k in range(3):
                ahead, behind = points.copy(), points.copy()
                ahead[i, p, k] += step
                behind[i, p, k] -= step
                change = derivatives(contacts, ahead)[0] - derivatives(contacts, behind)[0]
                found[k] = change[i, p] / (2.0 * step)
            assert told == pytest.approx(found, abs=1e-6)
            assert np.linalg.eigvalsh(told).min() > -1e-12


def test_a_point_on_the_plane_is_pushed_by_the_force_it_was_given():
    """At gap 0 the pressing force is the multiplier, whatever the stiffness."""
    for stiffness in (1.0, 1e6):
        contacts = Contacts(
            first=np.array([0, 1]),
            node=np.array([[0, 0]]),
            normal=np.array([[0.0, 0.0, 1.0]]),
            offset=np.array([[0.2, 0.4]]),
            target=np.zeros((1, 2, 3)),
            strength=np.array([[stiffness, 7.0, 0.0, 1.0]]),
        )
        points = np.zeros((1, 3, 3))
        points[0, 0] = 5.0, -3.0, 0.3  # the plane stands at 0.3 halfway
        force = np.zeros((1, 3, 3))
        add_contact_forces(contacts, 0, 0.5, points, force)
        assert force[0, 0] == pytest.approx([0.0, 0.0, -7.0], abs=1e-9 * stiffness)


def test_friction_sets_in_smoothly_and_ends_at_its_bound():
    for smoothing in (1e-5, 0.1):
        for slip in np.linspace(0.01, 3.0, 40) * smoothing:
            _, slope, ratio, second = friction_potential(slip, smoothing)
            step = 1e-5 * smoothing
            ahead = friction_potential(slip + step, smoothing)
            behind = friction_potential(slip - step, smoothing)
            assert slope == pytest.approx((ahead[0] - behind[0]) / (2 * step), rel=1e-6)
            assert second == pytest.approx(
                (ahead[1] - behind[1]) / (2 * step), abs=1e-4 / smoothing
            )
            assert ratio == pytest.approx(slope / slip)
            assert slope == 1.0 if slip >= smoothing else 0.0 < slope < 1.0
