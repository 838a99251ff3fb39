"""Rotations: what the words say, closed forms, and every way round giving the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deform.errors import OptionError
from deform.geometry import _kernels_rotation as kernels
from deform.geometry import rotation

ANGLE = st.floats(-180.0, 180.0)
VECTOR = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)


def test_heading_east_points_the_forward_axis_east():
    assert rotation.attitude_to_matrix(90, 0, 0) @ [0, 1, 0] == pytest.approx([1, 0, 0], abs=1e-15)


def test_positive_pitch_lifts_the_nose():
    assert (rotation.attitude_to_matrix(0, 10, 0) @ [0, 1, 0])[2] == pytest.approx(np.sin(np.radians(10)))


def test_positive_roll_puts_the_right_side_down():
    assert (rotation.attitude_to_matrix(0, 0, 10) @ [1, 0, 0])[2] == pytest.approx(-np.sin(np.radians(10)))


@given(ANGLE, ANGLE, ANGLE)
def test_attitude_is_the_product_of_its_three_turns(azimuth, pitch, roll):
    wanted = Rotation.from_euler("ZXY", [-azimuth, pitch, roll], degrees=True).as_matrix()
    assert rotation.attitude_to_matrix(azimuth, pitch, roll) == pytest.approx(wanted, abs=1e-14)


@given(st.floats(0, 359.99), st.floats(-89, 89), st.floats(-179.9, 179.9))
def test_attitude_comes_back_from_its_matrix(azimuth, pitch, roll):
    back = rotation.matrix_to_attitude(rotation.attitude_to_matrix(azimuth, pitch, roll))
    assert abs((back[0] - azimuth + 180) % 360 - 180) < 1e-10
    assert back[1:] == pytest.approx((pitch, roll), abs=1e-10)


@given(VECTOR)
def test_rotation_vector_matrix_and_quaternion_agree(vector):
    matrix = rotation.rotation_vector_to_matrix(vector)
    assert matrix == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-14)
    quaternion = rotation.rotation_vector_to_quaternion(vector)
    assert np.linalg.norm(quaternion) == pytest.approx(1, abs=1e-14)
    assert rotation.quaternion_to_matrix(quaternion) == pytest.approx(matrix, abs=1e-14)
    assert rotation.quaternion_to_matrix(rotation.matrix_to_quaternion(matrix)) == pytest.approx(matrix, abs=1e-14)
    if np.linalg.norm(vector) < 3.1:
        assert rotation.matrix_to_rotation_vector(matrix) == pytest.approx(vector, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.00999, 0.01, 0.01001, 0.5, 3.0])
def test_savage_coefficients_are_smooth_through_the_series(angle):
    s, c = rotation.savage_coefficients(angle)
    terms_s = sum((-1) ** k * angle ** (2 * k) / float(np.prod(np.arange(1.0, 2 * k + 2))) for k in range(20))
    terms_c = sum((-1) ** k * angle ** (2 * k) / float(np.prod(np.arange(1.0, 2 * k + 3))) for k in range(20))
    assert s == pytest.approx(terms_s, rel=1e-14)
    assert c == pytest.approx(terms_c, rel=1e-14)


@given(VECTOR, VECTOR)
def test_quaternion_product_is_the_matrix_product(first, second):
    a, b = rotation.rotation_vector_to_quaternion(first), rotation.rotation_vector_to_quaternion(second)
    product = rotation.quaternion_to_matrix(rotation.quaternion_multiply(a, b))
    assert product == pytest.approx(
        rotation.rotation_vector_to_matrix(first) @ rotation.rotation_vector_to_matrix(second), abs=1e-13
    )
    assert kernels.quaternion_product(*a, *b) == pytest.approx(rotation.quaternion_multiply(a, b), abs=1e-15)


@given(VECTOR, VECTOR)
def test_skew_is_the_vector_product(a, b):
    assert rotation.skew(a) @ b == pytest.approx(np.cross(a, b), abs=1e-14)
    assert kernels.cross(*a, *b) == pytest.approx(np.cross(a, b), abs=1e-15)


@given(VECTOR, VECTOR)
def test_turning_in_place_is_multiplying_by_the_matrix_of_the_vector(start, turn):
    C, M = rotation.rotation_vector_to_matrix(start), rotation.rotation_vector_to_matrix(turn)
    right, left = C.copy(), C.copy()
    kernels.turn_right(right, *turn)
    kernels.turn_left(left, *turn)
    assert right == pytest.approx(C @ M, abs=1e-14)
    assert left == pytest.approx(M @ C, abs=1e-14)
    assert kernels.rotate(C, *turn) == pytest.approx(C @ turn, abs=1e-14)
    assert kernels.rotate_back(C, *turn) == pytest.approx(C.T @ turn, abs=1e-14)


@given(VECTOR, st.integers(0, 2**31))
def test_condition_adjustment_is_the_polar_factor(vector, seed):
    noisy = rotation.rotation_vector_to_matrix(vector) + np.random.default_rng(seed).normal(0, 1e-3, (3, 3))
    adjusted = rotation.orthonormalise(noisy, "condition")
    assert adjusted.T @ adjusted == pytest.approx(np.eye(3), abs=1e-14)
    assert adjusted == pytest.approx(rotation.orthonormalise(noisy, "polar"), abs=1e-5)


@given(VECTOR, st.integers(0, 2**31))
def test_all_orthonormalisations_agree_for_the_departures_of_a_mechanization(vector, seed):
    noisy = rotation.rotation_vector_to_matrix(vector) + np.random.default_rng(seed).normal(0, 1e-9, (3, 3))
    polar = rotation.orthonormalise(noisy, "polar")
    kernel = noisy.copy()
    kernels.orthonormalise(kernel)
    for other in (rotation.orthonormalise(noisy, "condition"), rotation.orthonormalise(noisy, "quaternion"), kernel):
        assert other == pytest.approx(polar, abs=1e-14)


def test_orthonormalised_is_nearer_than_any_other_rotation():
    rng = np.random.default_rng(1)
    noisy = np.eye(3) + rng.normal(0, 0.01, (3, 3))
    best = rotation.orthonormalise(noisy, "polar")
    others = rotation.rotation_vector_to_matrix(rng.normal(0, 0.01, (200, 3))) @ best
    assert (np.linalg.norm(others - noisy, axis=(1, 2)) >= np.linalg.norm(best - noisy)).all()


def test_unknown_orthonormalisation_is_refused_with_the_known_ones():
    with pytest.raises(OptionError, match="polar"):
        rotation.orthonormalise(np.eye(3), "gram")


def test_half_turns_keep_their_axis():
    for axis in np.eye(3):
        back = rotation.matrix_to_rotation_vector(rotation.rotation_vector_to_matrix(np.pi * axis))
        assert np.abs(back) == pytest.approx(np.pi * axis, abs=1e-7)


def test_shapes_are_kept():
    angles = np.zeros((2, 5))
    assert rotation.attitude_to_matrix(angles, 0.0, 0.0).shape == (2, 5, 3, 3)
    assert rotation.quaternion_to_rotation_vector(np.tile([1.0, 0, 0, 0], (2, 5, 1))).shape == (2, 5, 3)
    with pytest.raises(ValueError, match="does not end"):
        rotation.quaternion_to_matrix(np.zeros((2, 3)))
