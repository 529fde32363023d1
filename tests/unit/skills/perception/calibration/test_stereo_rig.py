import dataclasses

import msgspec
import numpy as np
import pytest
from board_pictures import BOARD, angles, lens_camera, shots_of

from dlokit.description.scene import default_calibration
from dlokit.errors import SkillFailure
from dlokit.skills.perception.calibration.stereo_rig import calibrate_rig

CAMERA = lens_camera()


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


def test_too_few_pictures_and_cameras_that_are_not_parallel_are_refused():
    shots = shots_of(angles(10), CAMERA)
    with pytest.raises(SkillFailure, match="at least 8"):
        calibrate_rig(shots[:7], BOARD, default_calibration())
    down = np.array([0.0, 1.0])
    turned = [
        dataclasses.replace(shot, right=dataclasses.replace(shot.right, pixels=shot.right.pixels + 10.0 * down))
        for shot in shots
        if shot.right is not None
    ]
    with pytest.raises(SkillFailure, match="parallel"):
        calibrate_rig(turned, BOARD, default_calibration())
