import cv2
import msgspec
import numpy as np
import pytest
from stereo_scene import Scene, calibration

from dlokit.skills.perception.rectification import rectified
from dlokit.types.image import CameraCalibration, StereoImages

LENS = np.array([-0.25, 0.08, 0.0, 0.0, 0.0], dtype=np.float32)  # a wide-angle lens: 20 px at the border


def distorted(picture: np.ndarray, camera: CameraCalibration) -> np.ndarray:
    """The image as taken through that lens."""
    K = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px].astype(np.float32)
    pixels = np.column_stack([u.ravel(), v.ravel()])[:, None]
    ideal = cv2.undistortPoints(pixels, K, LENS.astype(np.float64), P=K).reshape(*u.shape, 2).astype(np.float32)
    return np.asarray(cv2.remap(picture, ideal[..., 0], ideal[..., 1], cv2.INTER_LINEAR))


def test_pictures_without_distortion_pass_untouched(s_scene: Scene):
    assert rectified(s_scene.images) is s_scene.images


def test_lens_distortion_is_corrected_in_both_images(s_scene: Scene):
    camera = msgspec.structs.replace(calibration(), distortion=LENS, distortion_right=LENS)
    clean = [cv2.GaussianBlur(picture, (0, 0), 2.0) for picture in (s_scene.images.left, s_scene.images.right)]
    left, right = (distorted(picture, camera) for picture in clean)
    found = rectified(StereoImages(stamp_ns=1, left=left, right=right, calibration=camera))
    middle = (slice(60, -60), slice(60, -60))  # what the distorted picture still contains
    for before, expected, after in ((left, clean[0], found.left), (right, clean[1], found.right)):
        wrong = np.mean(np.abs(before[middle].astype(float) - expected[middle]))
        rest = np.mean(np.abs(after[middle].astype(float) - expected[middle]))
        assert rest < 0.2 * wrong  # interpolating twice blurs a little
    assert found.calibration.distortion is None
    assert found.calibration.distortion_right is None


def test_a_second_pair_with_another_lens_is_not_rectified_by_the_first_ones_map(s_scene: Scene):
    strong = msgspec.structs.replace(calibration(), distortion=LENS)
    weak = msgspec.structs.replace(calibration(), distortion=LENS * np.float32(0.1))
    first = rectified(msgspec.structs.replace(s_scene.images, calibration=strong))
    second = rectified(msgspec.structs.replace(s_scene.images, calibration=weak))
    assert not np.array_equal(first.left, second.left)
    np.testing.assert_array_equal(second.right, s_scene.images.right)  # that lens has none


def test_the_maps_of_a_lens_are_computed_once(s_scene: Scene, monkeypatch: pytest.MonkeyPatch):
    pair = msgspec.structs.replace(s_scene.images, calibration=msgspec.structs.replace(calibration(), distortion=LENS))
    first = rectified(pair)
    monkeypatch.delattr(cv2, "initUndistortRectifyMap")
    np.testing.assert_array_equal(rectified(pair).left, first.left)
