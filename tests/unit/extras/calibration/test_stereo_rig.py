import dataclasses

import cv2
import msgspec
import numpy as np
import pytest
from board_pictures import (
    BOARD,
    NOISE_PX,
    angles,
    lens_camera,
    seen_in_world,
    separate_camera,
    shots_of,
    workspace_points,
)
from scipy.spatial.transform import Rotation

from dlokit.description.default_cameras import default_calibration
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.charuco import BoardView
from dlokit.extras.calibration.rig_quality import corners_deviation_m, held_out_rig
from dlokit.extras.calibration.stereo_rig import BoardShot, RigFit, calibrate_rig
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration

CAMERA, SEPARATE = lens_camera(), separate_camera()


@pytest.fixture(scope="module")
def separate_shots() -> list[BoardShot]:
    return shots_of(angles(25), SEPARATE)


@pytest.fixture(scope="module")
def separate_fit(separate_shots: list[BoardShot]) -> RigFit:
    return calibrate_rig(separate_shots, BOARD, default_calibration())


def test_intrinsics_lenses_and_baseline_are_found():
    shots = shots_of(angles(25), CAMERA)
    guess = msgspec.structs.replace(default_calibration(), fx_px=650.0, fy_px=650.0, baseline_m=None)
    fit = calibrate_rig(shots, BOARD, guess)
    assert fit.rms_px < 0.1
    assert fit.corners == 25 * 2 * len(BOARD.corners_board)
    for name, tolerance in (("fx_px", 1.5), ("fy_px", 1.5), ("cx_px", 2.0), ("cy_px", 2.0)):
        assert getattr(fit.camera, name) == pytest.approx(getattr(CAMERA, name), abs=tolerance), name
    assert fit.camera.baseline_m == pytest.approx(CAMERA.baseline_m, rel=2e-3)
    assert fit.camera.distortion is not None
    assert CAMERA.distortion is not None
    np.testing.assert_allclose(fit.camera.distortion[0], CAMERA.distortion[0], atol=0.02)


def test_a_single_camera_has_no_baseline():
    shots = [dataclasses.replace(shot, right=None) for shot in shots_of(angles(25), CAMERA)]
    fit = calibrate_rig(shots, BOARD, default_calibration())
    assert fit.camera.baseline_m is None
    assert fit.camera.distortion_right is None
    assert fit.camera.fx_px == pytest.approx(CAMERA.fx_px, abs=2.0)


def test_a_parallel_pair_is_recognised():
    fit = calibrate_rig(shots_of(angles(12), CAMERA), BOARD, default_calibration())
    assert fit.parallel
    assert fit.camera.raw_left is None


def test_two_separate_cameras_are_found_by_pictures_in_which_corners_are_missing(separate_shots: list[BoardShot]):
    half = [dataclasses.replace(shot, right=some_corners(shot.right)) for shot in separate_shots]
    half[3] = dataclasses.replace(half[3], right=None)
    guess = msgspec.structs.replace(default_calibration(), baseline_m=None)
    fit = calibrate_rig(half, BOARD, guess)
    assert not fit.parallel
    assert fit.rms_px < 0.1
    for raw, true in ((fit.camera.raw_left, SEPARATE.raw_left), (fit.camera.raw_right, SEPARATE.raw_right)):
        assert raw is not None
        assert true is not None
        assert raw.fx_px == pytest.approx(true.fx_px, abs=1.5)
        assert raw.cy_px == pytest.approx(true.cy_px, abs=2.0)
        turn_deg = np.degrees(2.0 * np.arccos(min(1.0, abs(float(raw.wxyz @ true.wxyz)))))
        assert turn_deg < 0.2  # 2 px of the principal point are 0.15°
    assert fit.camera.baseline_m == pytest.approx(SEPARATE.baseline_m, rel=2e-3)


@pytest.mark.heavy
def test_the_fit_is_as_good_as_opencvs_stereo_calibration(separate_shots: list[BoardShot], separate_fit: RigFit):
    shots, fit = separate_shots, separate_fit
    corners = [BOARD.corners_board.astype(np.float32)] * len(shots)
    left, right = ([view.pixels.astype(np.float32) for view in views] for views in zip(*both(shots), strict=True))
    size = (SEPARATE.width_px, SEPARATE.height_px)
    guess = np.array([[722.0, 0.0, 320.0], [0.0, 722.0, 280.0], [0.0, 0.0, 1.0]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS + cv2.CALIB_FIX_K3
    found = cv2.stereoCalibrate(corners, left, right, guess, np.zeros(5), guess.copy(), np.zeros(5), size, flags=flags)
    assert fit.rms_px < 1.001 * found[0]
    assert fit.camera.baseline_m == pytest.approx(float(np.linalg.norm(found[6])), abs=2e-4)


@pytest.mark.heavy
def test_quality_of_a_pair_by_pictures_that_were_not_fitted_and_at_the_corners_of_its_space(
    separate_shots: list[BoardShot], separate_fit: RigFit
):
    shots, fit = separate_shots, separate_fit
    apart = held_out_rig(shots, BOARD, default_calibration())
    assert len(apart.rows_px) == 5 * len(BOARD.corners_board)
    assert np.percentile(apart.rows_px, 95) < 4 * NOISE_PX
    assert np.percentile(apart.board_m, 95) < 3e-3  # 0.1 px of disparity are 2 mm at 1.3 m
    deviation_m = corners_deviation_m(fit, shots, BOARD)
    assert deviation_m.shape == (8,)
    assert 1e-4 < deviation_m.max() < 4e-3
    few = shots[:10]
    assert corners_deviation_m(calibrate_rig(few, BOARD, default_calibration()), few, BOARD).max() > deviation_m.max()


@pytest.mark.heavy
def test_the_deviation_at_the_corners_is_that_of_repeated_calibrations():
    poses, points = angles(12), workspace_points()
    centred = points - points.mean(axis=0)
    errors_m: list[Float64Array] = []
    all_shots = [shots_of(poses, SEPARATE, seed=seed) for seed in range(8)]
    fits = [calibrate_rig(shots, BOARD, default_calibration()) for shots in all_shots]
    for fit in fits:
        camera = msgspec.structs.replace(fit.camera, T_world_camera=SEPARATE.T_world_camera)
        seen = seen_in_world(points, SEPARATE, camera)
        seen -= seen.mean(axis=0)
        errors_m.append(Rotation.align_vectors(centred, seen)[0].apply(seen) - centred)
    deviation_m = corners_deviation_m(fits[-1], all_shots[-1], BOARD).max()
    spread_m = np.sqrt(np.mean(np.sum(np.array(errors_m) ** 2, axis=-1), axis=0)).max()
    # The points are within that space: their error is smaller than at its corners, and not by an order of magnitude.
    assert spread_m < 1.5 * deviation_m
    assert deviation_m < 8.0 * spread_m


def test_too_few_pictures_and_corners_that_fit_no_pair_are_refused():
    shots = shots_of(angles(10), CAMERA)
    with pytest.raises(SkillFailure, match="at least 8"):
        calibrate_rig(shots[:7], BOARD, default_calibration())
    alone = [dataclasses.replace(shot, right=None) for shot in shots[3:]]
    with pytest.raises(SkillFailure, match="3 pictures show the board to both"):
        calibrate_rig([*shots[:3], *alone], BOARD, default_calibration())
    moved: list[BoardShot] = []
    for index, (left, right) in enumerate(both(shots)):
        elsewhere = right.pixels + np.array([0.0, 4.0 * index])
        moved.append(BoardShot(left=left, right=BoardView(numbers=right.numbers, pixels=elsewhere)))
    with pytest.raises(SkillFailure, match="the same moment"):
        calibrate_rig(moved, BOARD, default_calibration())


@pytest.mark.parametrize("camera", [CAMERA, SEPARATE], ids=["parallel", "separate"])
def test_exchanged_cameras_are_named(camera: CameraCalibration):
    exchanged = [BoardShot(left=right, right=left) for left, right in both(shots_of(angles(10), camera))]
    with pytest.raises(SkillFailure, match="exchange the two"):
        calibrate_rig(exchanged, BOARD, default_calibration())


def both(shots: list[BoardShot]) -> list[tuple[BoardView, BoardView]]:
    return [(shot.left, shot.right) for shot in shots if shot.right is not None]


def some_corners(view: BoardView | None) -> BoardView | None:
    """Those that are left where a corner of the board is hidden."""
    return None if view is None else BoardView(numbers=view.numbers[9:], pixels=view.pixels[9:])


def test_boards_that_all_face_the_camera_do_not_tell_its_focal_length():
    rng = np.random.default_rng(0)
    corners = BOARD.corners_board[:, :2]
    shots: list[BoardShot] = []
    for _ in range(10):
        depth_m, aside_m = rng.uniform(0.5, 0.8), rng.uniform(-0.15, -0.05, 2)
        pixels = CAMERA.fx_px * (corners + aside_m) / depth_m + (CAMERA.cx_px, CAMERA.cy_px)
        noise = rng.normal(0.0, NOISE_PX, pixels.shape)
        shots.append(BoardShot(left=BoardView(numbers=np.arange(len(pixels)), pixels=pixels + noise)))
    with pytest.raises(SkillFailure, match="tilted to all sides, near and far"):
        calibrate_rig(shots, BOARD, default_calibration())
