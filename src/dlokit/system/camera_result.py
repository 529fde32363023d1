"""What was said of the camera, as `result.json` tells it."""

from dlokit.decision.task import CameraReport
from dlokit.system.run_result import CameraResult


def camera_result(report: CameraReport) -> CameraResult:
    """The figures of a check of the camera's place."""
    check = report.check
    if check is None:
        return CameraResult(text=report.text)
    x_m, y_m = check.offset_m.tolist()
    return CameraResult(
        text=report.text, offset_x_m=x_m, offset_y_m=y_m, yaw_rad=check.yaw_rad, scatter_m=check.scatter_m
    )
