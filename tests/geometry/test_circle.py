"""Circle and ellipse adjustment: exact shapes, plain twins, the theoretical bound, dents, missing arms."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from deform.errors import InputError
from deform.geometry.circle import adjust_circle, adjust_ellipse, fit_ellipse_direct

_SPEC = importlib.util.spec_from_file_location("naive_circle", Path(__file__).parents[1] / "naive" / "circle.py")
naive = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(naive)


def sections(n, arms=40, radius=0.25, ovality=0.02, offset=0.002, noise=0.0, seed=3):
    """Return n sections of one ovality with random centre and orientation; x, z, truth (n, 5)."""
    rng = np.random.default_rng(seed)
    angle = np.arange(arms) * 2 * np.pi / arms
    truth = np.empty((n, 5))
    truth[:, :2] = rng.normal(0, offset, (n, 2))
    truth[:, 2], truth[:, 3] = radius * (1 + ovality / 2), radius * (1 - ovality / 2)
    truth[:, 4] = rng.uniform(0, np.pi, n)
    size = (
        naive.ray_length(truth.T[:, :, None], angle[None, :]) + rng.normal(0, noise, (n, arms))
        if noise
        else naive.ray_length(truth.T[:, :, None], angle[None, :])
    )
    return size * np.sin(angle), size * np.cos(angle), truth


def turn(angle):
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def test_an_exact_ellipse_is_found_exactly_by_both_ways():
    x, z, truth = sections(50)
    for values in (fit_ellipse_direct(x, z), np.stack([*(f := adjust_ellipse(x, z)).__dict__.values()][:5], axis=1)):
        assert np.abs(values[:, :4] - truth[:, :4]).max() < 1e-9
        assert np.abs(turn(values[:, 4] - truth[:, 4])).max() < 1e-7
    assert np.abs(f.residual).max() < 1e-9


def test_the_adjustment_equals_a_general_solver_on_the_rays():
    x, z, truth = sections(12, noise=3e-4)
    fit = adjust_ellipse(x, z, 3e-4)
    angle, size = np.arctan2(x[0], z[0]), np.hypot(x, z)
    for k in range(12):
        values, covariance = naive.ellipse_by_rays(size[k], angle, truth[k], 3e-4)
        mine = np.array([fit.right[k], fit.up[k], fit.semi_major[k], fit.semi_minor[k], fit.orientation[k]])
        sigma = np.sqrt(np.diag(covariance))
        assert np.abs((mine - values)[:4] / sigma[:4]).max() < 0.02
        assert abs(turn(mine[4] - values[4])) / sigma[4] < 0.02
        assert np.sqrt(np.diag(fit.covariance[k])) == pytest.approx(sigma, rel=0.02)
        assert fit.residual[k] == pytest.approx(size[k] - naive.ray_length(mine, angle), abs=4e-6)


def test_the_circle_equals_the_printed_matrices_of_porter():
    x, z, _ = sections(5, ovality=0.0, noise=3e-4)
    fit = adjust_circle(x, z, 3e-4, tangential_sigma=3e-4)
    for k in range(5):
        unknowns, covariance, residual = naive.circle_by_porter(x[k], z[k], 3e-4)
        assert [fit.semi_major[k], -fit.right[k], -fit.up[k]] == pytest.approx(unknowns, abs=1e-6)
        assert np.sqrt(np.diag(fit.covariance[k]))[[2, 0, 1]] == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.01)
        assert np.abs(fit.residual[k]) == pytest.approx(np.hypot(*residual.T), abs=2e-6)


def test_ovality_error_meets_the_theoretical_bound():
    x, z, _ = sections(60_000, noise=2e-4)
    fit, direct = adjust_ellipse(x, z, 2e-4), fit_ellipse_direct(x, z)
    by_direct = 2 * (direct[:, 2] - direct[:, 3]) / (direct[:, 2] + direct[:, 3])
    bound = 2 * 2e-4 * np.sqrt(2 / 40) / 0.25  # four amplitudes of the second harmonic over the diameter: 3.58e-4
    for ovality in (fit.ovality, by_direct):
        error = ovality - 0.02
        assert np.sqrt(np.mean(error**2)) == pytest.approx(bound, rel=0.03)
        assert abs(error.mean()) < 1e-5
    assert fit.ovality_sigma.mean() == pytest.approx(bound, rel=0.02)


def test_covariance_is_the_scatter():
    x, z, truth = sections(30_000, noise=3e-4)
    fit = adjust_ellipse(x, z, 3e-4)
    error = np.stack([fit.right, fit.up, fit.semi_major, fit.semi_minor, turn(fit.orientation - truth[:, 4])], axis=1)
    error[:, :4] -= truth[:, :4]
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(fit.covariance), error)
    assert square.mean() == pytest.approx(5.0, rel=0.03)
    assert (fit.sigma_unit**2).mean() == pytest.approx(1.0, rel=0.02)


def test_a_round_pipe_has_a_finite_covariance_and_no_sure_direction():
    x, z, _ = sections(200, ovality=0.0, noise=3e-4)
    fit = adjust_ellipse(x, z, 3e-4)
    assert np.isfinite(fit.covariance).all()
    assert np.sqrt(fit.covariance[:, 4, 4]).min() > 0.1


def test_turning_the_section_turns_only_its_direction():
    x, z, _ = sections(20, noise=3e-4)
    fit, turned = adjust_ellipse(x, z), adjust_ellipse(x * np.cos(0.7) + z * np.sin(0.7), z * np.cos(0.7) - x * np.sin(0.7))
    assert turned.semi_major == pytest.approx(fit.semi_major, abs=1e-9)
    assert np.abs(turn(turned.orientation - fit.orientation - 0.7)).max() < 1e-6


def test_a_dent_carries_no_weight_in_the_robust_fit_and_stands_in_its_residuals():
    x, z, truth = sections(100, arms=64, noise=2e-4)
    keep = np.ones(64)
    keep[10:16] -= 0.04 * np.hanning(8)[1:-1]
    plain, robust = adjust_ellipse(x * keep, z * keep, 2e-4), adjust_ellipse(x * keep, z * keep, 2e-4, robust=True)
    assert np.abs(plain.semi_major - truth[:, 2]).max() > 5e-4
    assert np.abs(robust.semi_major - truth[:, 2]).mean() < 1e-4
    assert robust.residual[:, 12:14].mean() == pytest.approx(-0.25 * 0.04 * np.hanning(8)[3:5].mean(), rel=0.05)
    assert (robust.points < 62).all()
    assert plain.bad.all()


def test_missing_arms_cost_precision_and_nothing_else():
    x, z, truth = sections(500, noise=3e-4)
    x[:, 5:10] = np.nan
    fit, direct = adjust_ellipse(x, z, 3e-4), fit_ellipse_direct(x, z)
    assert np.isnan(fit.residual[:, 5:10]).all()
    assert np.isfinite(fit.semi_major).all()
    assert np.mean(((fit.semi_major - truth[:, 2]) / np.sqrt(fit.covariance[:, 2, 2])) ** 2) == pytest.approx(1.0, rel=0.2)
    assert direct[:, 2] == pytest.approx(fit.semi_major, abs=2e-4)


def test_too_few_points_are_flagged_and_others_are_untouched():
    x, z, _ = sections(3)
    x[1, 4:] = np.nan
    fit = adjust_ellipse(x, z)
    assert fit.bad.tolist() == [False, True, False]
    assert np.isnan(fit.semi_major[1])


def test_points_of_another_shape_and_a_sigma_of_zero_are_named():
    with pytest.raises(InputError, match="shapes"):
        adjust_ellipse(np.zeros((2, 8)), np.zeros((2, 7)))
    with pytest.raises(InputError, match="sigma"):
        adjust_ellipse(np.ones((1, 8)), np.ones((1, 8)), sigma=0.0)
