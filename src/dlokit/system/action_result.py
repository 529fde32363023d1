"""What an action was, as `result.json` tells it."""

from dlokit.decision.task import ActionRecord, CorrectionRecord
from dlokit.geometry import rmse_m
from dlokit.system.run_result import ActionResult, CorrectionResult


def action_result(action: ActionRecord) -> ActionResult:
    """The figures of an action."""
    return ActionResult(
        action=action.action,
        kind=action.kind,
        grasp_node=action.grasp_node,
        grasp_ok=action.grasp_ok,
        slipped=action.slipped,
        rmse_m=action.rmse_m,
        predicted_rmse_m=action.predicted_rmse_m,
        missed_m=None if action.expected_world is None else rmse_m(action.nodes_world, action.expected_world),
        duration_s=action.duration_s,
        robot_time_s=action.robot_time_s,
        path_length_m=action.path_length_m,
        planning_time_s=action.planning_time_s,
        corrections=tuple(_correction(done) for done in action.corrections),
        control_end=action.control_end or None,
        ended_by=action.ended_by or None,
    )


def _correction(done: CorrectionRecord) -> CorrectionResult:
    x_m, y_m, z_m, yaw_rad = done.displacement.tolist()
    return CorrectionResult(
        x_m=x_m,
        y_m=y_m,
        z_m=z_m,
        yaw_rad=yaw_rad,
        before_m=done.before_m,
        predicted_m=done.predicted_m,
        seen_m=done.seen_m,
    )
