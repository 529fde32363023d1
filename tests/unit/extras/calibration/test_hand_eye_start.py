import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlokit.extras.calibration.hand_eye_start import METHODS
from dlokit.types.arrays import Float64Array


def transform(turn: Rotation, shift: Float64Array) -> Float64Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), shift
    return T


def motions(count: int, noise: float) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    rng = np.random.default_rng(0)
    X = transform(Rotation.from_rotvec([1.8, 0.3, -0.5]), np.array([0.5, 0.6, 1.0]))
    Y = transform(Rotation.from_rotvec([0.3, 1.5, -1.0]), np.array([0.03, 0.1, -0.05]))
    turns = Rotation.from_rotvec(rng.normal(0.0, 0.5, (count, 3)) + np.array([2.0, 0.5, 0.0]))
    A = np.array([transform(turn, rng.normal(0.0, 0.2, 3)) for turn in turns])
    errors = [transform(Rotation.from_rotvec(rng.normal(0.0, noise, 3)), rng.normal(0.0, noise, 3)) for _ in A]
    return A, np.linalg.inv(X) @ A @ Y @ np.array(errors), X, Y


@pytest.mark.parametrize("method", METHODS)
def test_exact_poses_give_the_exact_solution(method: str):
    A, B, X, Y = motions(6, noise=0.0)
    found = METHODS[method](A, B)
    np.testing.assert_allclose(found.T_world_camera, X, atol=1e-9)
    np.testing.assert_allclose(found.T_tcp_board, Y, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_noise_of_a_millimetre_and_a_milliradian_moves_the_camera_by_about_as_much(method: str):
    A, B, X, _ = motions(20, noise=1e-3)
    found = METHODS[method](A, B)
    assert np.linalg.norm(found.T_world_camera[:3, 3] - X[:3, 3]) < 1.5e-3
    assert Rotation.from_matrix(X[:3, :3].T @ found.T_world_camera[:3, :3]).magnitude() < 1.5e-3
