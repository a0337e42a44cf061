"""Properties of rigid transforms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evg_app import geometry as g

ATOL = 1e-9

numbers = st.floats(-2.0, 2.0, allow_nan=False)
quaternions = st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 1e-3)
vectors = st.tuples(numbers, numbers, numbers)


@given(quaternions, vectors)
def test_inverse_undoes_the_transform(q, t):
    T = g.from_quaternion(q, t)
    assert g.is_transform(T)
    np.testing.assert_allclose(g.invert(T) @ T, np.eye(4), atol=ATOL)


@given(quaternions)
def test_quaternion_round_trip_up_to_sign(q):
    q = np.asarray(q) / np.linalg.norm(q)
    back = g.to_quaternion(g.from_quaternion(q))
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) < 1e-6


def test_quaternion_without_length_is_refused():
    with pytest.raises(ValueError, match="cannot be normalised"):
        g.from_quaternion((0, 0, 0, 0))


@given(quaternions, vectors, vectors)
def test_points_follow_composition(q, t, p):
    T_a_b, T_b_c = g.from_quaternion(q, t), g.translation(*t)
    np.testing.assert_allclose(
        g.transform_points(T_a_b @ T_b_c, p), g.transform_points(T_a_b, g.transform_points(T_b_c, p)), atol=1e-8
    )


def test_rotation_about_z_is_the_group_element_of_the_paper():
    np.testing.assert_allclose(g.transform_points(g.rotation_about("z", np.pi / 2), (1, 2, 3)), (-2, 1, 3), atol=ATOL)


def test_side_view_is_the_published_extrinsic():
    """Spec §11.2: t(-0.15, 0.1616, 0.5201), q(-0.866, 0, 0, -0.5), camera at (0.15, -0.3696, 0.4)."""
    T_task_cam = g.camera_on_sphere((0.15, 0.15, 0.1), 0.6, np.deg2rad(60), np.deg2rad(-90))
    np.testing.assert_allclose(T_task_cam[:3, 3], (0.15, -0.3696, 0.4), atol=1e-4)
    T_cam_task = g.invert(T_task_cam)
    np.testing.assert_allclose(T_cam_task[:3, 3], (-0.15, 0.1616, 0.5201), atol=1e-4)
    np.testing.assert_allclose(g.to_quaternion(T_cam_task), (0.866, 0, 0, 0.5), atol=1e-3)


def test_grasp_frame_chain_ends_at_frankas_tcp():
    """Hand to grasp 0.062 m, grasp to tcp 0.0414 m: Franka's hand_tcp is 0.1034 m from the hand."""
    np.testing.assert_allclose((g.T_HAND_GRASP @ g.T_GRASP_TCP)[:3, 3], (0, 0, 0.1034), atol=ATOL)


@given(quaternions, vectors)
def test_flipping_the_fingers_twice_changes_nothing(q, t):
    T = g.from_quaternion(q, t)
    np.testing.assert_allclose(T @ g.T_GRASP_FLIPPED @ g.T_GRASP_FLIPPED, T, atol=1e-8)
    np.testing.assert_allclose((T @ g.T_GRASP_FLIPPED)[:3, 2], T[:3, 2], atol=1e-8)


def test_rotation_angle_measures_the_turn():
    T = g.rotation_about("x", 0.7)
    assert abs(g.rotation_angle(np.eye(4), T) - 0.7) < ATOL


def test_mirrored_matrix_is_no_transform():
    assert not g.is_transform(np.diag([1.0, 1.0, -1.0, 1.0]))
