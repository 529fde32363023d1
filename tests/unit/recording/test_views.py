"""What Foxglove is told of the camera."""

import msgspec
import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.recording import foxglove as fox
from dlokit.recording.views import views_of
from dlokit.types.image import StereoImages

PICTURE = np.zeros((560, 640, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("coefficients", "model"), [(None, ""), (4, "plumb_bob"), (5, "plumb_bob"), (8, "rational_polynomial")]
)
def test_the_lens_model_is_that_of_its_coefficients(coefficients: int | None, model: str):
    lens = None if coefficients is None else np.full(coefficients, 0.01, dtype=np.float32)
    camera = msgspec.structs.replace(default_calibration(), distortion=lens)
    views = views_of(StereoImages(stamp_ns=1, left=PICTURE, right=PICTURE, calibration=camera))
    (seen,) = [view for _, view in views if isinstance(view, fox.CameraCalibration)]
    assert seen.distortion_model == model
