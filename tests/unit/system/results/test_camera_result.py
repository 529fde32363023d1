import numpy as np

from dlokit.decision.records import CameraReport
from dlokit.system.results.run_result import camera_result
from dlokit.types.image import CameraCheck


def test_a_correction_has_its_values_and_a_refusal_only_its_text() -> None:
    check = CameraCheck(
        offset_m=np.array([0.003, -0.004]), yaw_rad=0.001, center_world=np.zeros(2), scatter_m=1e-4, points=900
    )
    told = camera_result(CameraReport(text="off", check=check))
    assert (told.offset_x_m, told.offset_y_m, told.yaw_rad, told.scatter_m) == (0.003, -0.004, 0.001, 1e-4)
    kept = camera_result(CameraReport(text="scattered"))
    assert (kept.text, kept.offset_x_m, kept.yaw_rad) == ("scattered", None, None)
