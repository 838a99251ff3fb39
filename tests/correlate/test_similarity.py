"""Similarity transformation: vectors of the literature, invariances, covariance, outliers, what is undetermined."""

from __future__ import annotations

import numpy as np
import pytest

from deform.correlate.similarity import MODELS, fit_sections, fit_similarity
from deform.errors import InputError

# Ghilani and Wolf, Adjustment Computations: four points of the three-dimensional conformal transformation, with sigmas.
# The data and the scale 0.9499549354 of the general least squares solution stand in a public copy of the example.
LOCAL = np.array(
    [[1094.883, 820.085, 109.821], [503.891, 1598.698, 117.685], [2349.343, 207.658, 151.387], [1395.320, 1348.853, 215.261]]
)
LOCAL_SIGMA = np.array([[0.007, 0.008, 0.005], [0.011, 0.008, 0.009], [0.006, 0.005, 0.007], [0.005, 0.008, 0.009]])
GROUND = np.array(
    [[10037.81, 5262.09, 772.04], [10956.68, 5128.17, 783.00], [8780.08, 4840.29, 782.62], [10185.80, 4700.21, 851.32]]
)
GROUND_SIGMA = np.array([[0.05, 0.06, 0.05], [0.04, 0.06, 0.09], [0.02, 0.04, 0.02], [0.03, 0.05, 0.03]])


def random_rotation(rng) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.linalg.det(q)


def line_points(rng, n=30):
    """Points along a pipeline, 10 km."""
    return np.stack([np.linspace(0, 10000, n), 300 * rng.normal(size=n), 20 * rng.normal(size=n)], axis=1)


def test_ghilani_and_wolf_four_points_with_errors_in_both_systems():
    fit = fit_similarity(LOCAL, GROUND, GROUND_SIGMA)
    for _ in range(3):
        matrix = fit.scale * fit.rotation
        covariance = [np.diag(g**2) + matrix @ np.diag(s**2) @ matrix.T for g, s in zip(GROUND_SIGMA, LOCAL_SIGMA, strict=True)]
        fit = fit_similarity(LOCAL, GROUND, np.asarray(covariance))
    assert f"{fit.scale:.10f}" == "0.9499549354"
    np.testing.assert_allclose(fit.translation, [10233.854, 6549.964, 720.866], atol=0.001)


def test_ghilani_and_wolf_plane_example():
    # Example 18.1: stations A, B, C; a = -4.51249, b = -0.25371, Te = 1 050 003.715, Tn = 50 542.131, S = 4.51962
    plane = np.array([[121.622, -128.066, 0], [141.228, 187.718, 0], [175.802, 135.728, 0]])
    state = np.array([[1049422.40, 51089.20, 0], [1049413.95, 49659.30, 0], [1049244.95, 49884.95, 0]])
    fit = fit_similarity(plane, state, model="plane")
    assert fit.scale * fit.rotation[0, 0] == pytest.approx(-4.51249, abs=6e-6)
    assert fit.scale * fit.rotation[1, 0] == pytest.approx(-0.25371, abs=6e-6)
    np.testing.assert_allclose(fit.translation[:2], [1050003.715, 50542.131], atol=6e-4)
    assert fit.scale == pytest.approx(4.51962, abs=6e-6)


@pytest.mark.demo
def test_twenty_points_sk42_to_sk95_to_the_printed_digits(real):
    folder = real / "helmert_sk42_sk95"
    source, target = (np.loadtxt(folder / f"SK-{k}-points.txt") for k in (42, 95))
    printed = [
        [float(v) for v in row.split()]
        for row in (folder / "SK-42-SK-95-param-1.0.5.txt").read_text().splitlines()
        if row.strip()
    ]
    fit = fit_similarity(source, target)
    np.testing.assert_allclose(fit.rotation, printed[:3], atol=5.1e-11)
    assert fit.scale == pytest.approx(printed[4][0], abs=5.1e-11)
    # their translation carries the rounding of the rotation and the scale (1e-10 over 6.4e6 m)
    np.testing.assert_allclose(fit.translation, printed[3], atol=6e-4)
    theirs = np.loadtxt(folder / "SK-42-SK-95-diff-1.0.5.txt")
    np.testing.assert_allclose(fit.residual, -theirs, atol=2.5e-3)
    assert (fit.residual**2).sum() <= (theirs**2).sum()


@pytest.mark.demo
def test_the_seven_points_of_wuerttemberg(real):
    # Grafarend and Awange 2003, Nonlinear analysis of the three-dimensional datum transformation, Journal of Geodesy 77, 66
    folder = real / "helmert_sk42_sk95"
    fit = fit_similarity(np.loadtxt(folder / "ex_src.txt"), np.loadtxt(folder / "ex_dest.txt"))
    np.testing.assert_allclose(fit.translation, [641.8804, 68.6553, 416.3982], atol=6e-5)
    assert fit.scale == pytest.approx(1.00000558251985, abs=1e-13)
    np.testing.assert_allclose(fit.residual[0], [0.0940, 0.1351, 0.1402], atol=6e-5)


@pytest.mark.parametrize("model", list(MODELS))
def test_every_model_gives_back_what_made_the_points(model):
    rng = np.random.default_rng(1)
    source = line_points(rng)
    names = MODELS[model]
    angle = 0.7 if "rotation_z" in names else 0.0
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    rotation = random_rotation(rng) if "rotation_x" in names else turn
    scale = 1.02 if "scale" in names else 1.0
    shift = np.array([100.0, -50.0, 7.0 if "up" in names else 0.0])
    turned = source @ rotation.T
    target = shift + turned * ([scale, scale, 1.0] if "up" not in names else scale)
    fit = fit_similarity(source, target, 0.1, model=model)
    np.testing.assert_allclose(fit.residual, 0.0, atol=1e-7)
    assert fit.scale == pytest.approx(scale, abs=1e-11)
    np.testing.assert_allclose(fit.rotation, rotation, atol=1e-11)


def test_transforming_there_and_back_is_nothing():
    fit = fit_similarity(LOCAL, GROUND)
    np.testing.assert_allclose(fit.inverse(fit.apply(LOCAL)), LOCAL, atol=1e-9)
    np.testing.assert_allclose(fit.translation + fit.scale * LOCAL @ fit.rotation.T, fit.apply(LOCAL), atol=1e-8)


def test_covariance_is_what_repeated_surveys_scatter():
    rng = np.random.default_rng(2)
    source, sigma = line_points(rng, 12), np.linspace(0.05, 0.3, 12)
    fits = [fit_similarity(source, source + sigma[:, None] * rng.normal(size=source.shape), sigma) for _ in range(400)]
    scatter = np.std([[*f.shift, f.scale] for f in fits], axis=0)
    told = fits[0].sigma
    np.testing.assert_allclose(scatter, [told["east"], told["north"], told["up"], told["scale"]], rtol=0.12)
    assert np.mean([f.sigma0**2 for f in fits]) == pytest.approx(1.0, abs=0.05)
    w = np.concatenate([f.w.ravel() for f in fits])
    assert np.std(w) == pytest.approx(1.0, abs=0.03)
    place = np.array([[5000.0, 200.0, 10.0]])
    at = np.std([f.apply(place)[0] for f in fits], axis=0)
    np.testing.assert_allclose(at, np.sqrt(np.diag(fits[0].covariance_at(place)[0])), rtol=0.12)


def test_redundancy_numbers_sum_to_the_degrees_of_freedom():
    fit = fit_similarity(LOCAL, GROUND, GROUND_SIGMA)
    assert fit.redundancy.sum() == pytest.approx(fit.degrees_of_freedom, abs=1e-6)


def test_one_wrong_point_is_named_and_does_not_spoil_a_robust_fit():
    rng = np.random.default_rng(3)
    source = line_points(rng, 15)
    target = source + [10.0, 5.0, 1.0] + 0.1 * rng.normal(size=source.shape)
    wrong = target.copy()
    wrong[6] += [3.0, -40.0, 0.0]
    plain, robust, good = (
        fit_similarity(source, wrong, 0.1),
        fit_similarity(source, wrong, 0.1, robust=True),
        fit_similarity(np.delete(source, 6, 0), np.delete(target, 6, 0), 0.1),
    )
    assert plain.suspects[0] == 6
    assert robust.suspects[0] == 6
    assert robust.weight[6] < 1e-3
    np.testing.assert_allclose(robust.apply(source), good.apply(source), atol=0.1)
    assert np.abs(plain.apply(source) - good.apply(source)).max() > 1.0


def test_elongation_is_reported_as_scale_and_stays_in_the_residuals_of_a_rigid_fit():
    rng = np.random.default_rng(4)
    source = line_points(rng)
    target = source * 1.0005
    assert fit_similarity(source, target, 0.1).scale == pytest.approx(1.0005, abs=1e-9)
    assert np.abs(fit_similarity(source, target, 0.1, model="rigid").residual).max() > 1.0


def test_points_on_one_line_leave_the_roll_about_it_undetermined_and_say_so():
    source = np.stack([np.linspace(0, 1000, 9), np.zeros(9), np.zeros(9)], axis=1)
    fit = fit_similarity(source, source + np.array([1.0, 2.0, 3.0]), 0.1)
    assert len(fit.undetermined) == 1
    assert "rotation_x" in fit.undetermined[0]
    np.testing.assert_allclose(fit.residual, 0.0, atol=1e-9)


def test_sections_are_fitted_each_on_its_own():
    rng = np.random.default_rng(5)
    source = line_points(rng, 20)
    section = np.repeat([0, 1], 10)
    target = source + np.where(section[:, None] == 0, [1.0, 0, 0], [0, 0, 5.0])
    fits = fit_sections(source, target, section, 0.1, model="translation")
    np.testing.assert_allclose(fits[0].shift, [1.0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(fits[1].shift, [0, 0, 5.0], atol=1e-9)


def test_faults_are_named():
    with pytest.raises(InputError, match="needs 3"):
        fit_similarity(LOCAL[:2], GROUND[:2])
    with pytest.raises(InputError, match="unknown"):
        fit_similarity(LOCAL, GROUND, model="affine")
    with pytest.raises(InputError, match="finite"):
        fit_similarity(LOCAL, GROUND * np.nan)
    with pytest.raises(InputError, match="shapes"):
        fit_similarity(LOCAL, GROUND[:3])
