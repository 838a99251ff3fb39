"""Axial strain from joint lengths: scale, sigma, strings of joints."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.strain.axial import axial_strain

RNG = np.random.default_rng(0)
JOINTS = RNG.uniform(11.5, 12.5, 200)


def test_scale_of_the_odometer_is_no_strain():
    found = axial_strain(1.003 * JOINTS, JOINTS, 0.01, 0.01)
    assert found.scale == pytest.approx(1.003)
    np.testing.assert_allclose(found.strain, 0.0, atol=1e-12)


def test_strain_of_one_stretched_joint_is_found_with_an_honest_sigma():
    z = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        new = JOINTS + rng.normal(0.0, 0.01, JOINTS.size)
        new[50] += 2e-3 * JOINTS[50]
        found = axial_strain(new, JOINTS, 0.01, 0.0)
        z.append((found.strain[50] - 2e-3) / found.sigma[50])
    assert 0.85 < np.std(z) < 1.15
    assert abs(np.mean(z)) < 0.25


def test_spread_of_the_changes_stands_in_for_unknown_sigmas():
    new = JOINTS + RNG.normal(0.0, 0.02, JOINTS.size)
    found = axial_strain(new, JOINTS)
    assert found.length_sigma[0] == pytest.approx(0.02, rel=0.2)


def test_string_of_joints_is_sharper_than_one_of_them():
    ends = np.concatenate([[0.0], np.cumsum(JOINTS)])
    moved = ends * 1.0 + RNG.normal(0.0, 0.007, ends.size)
    found = axial_strain(np.diff(moved), JOINTS, 0.007, 0.007)
    strain, sigma = found.pooled(10, 29)
    assert sigma < 0.12 * found.sigma[10]
    assert abs(strain) < 4 * sigma


def test_joint_without_a_weld_has_no_strain():
    new = JOINTS.copy()
    new[3] = np.nan
    assert np.isnan(axial_strain(new, JOINTS, 0.01, 0.01).strain[3])


def test_lengths_of_other_joints_are_refused():
    with pytest.raises(InputError, match="same joints"):
        axial_strain(JOINTS, JOINTS[:-1])
    with pytest.raises(InputError, match="positive"):
        axial_strain(-JOINTS, JOINTS)
