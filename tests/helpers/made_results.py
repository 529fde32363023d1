"""Constructed results of runs, for tests of reports and summaries."""

import numpy as np

from dlokit.decision.records import ActionRecord
from dlokit.geometry import pose
from dlokit.system.results.run_result import ActionResult, RunResult
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import RunOutcome
from dlokit.types.robot import ArmProtection


def made_action(
    action: int,
    kind: str = "drag",
    *,
    grasp_ok: bool = True,
    rmse_m: float = 0.01,
    predicted_rmse_m: float | None = None,
    true_rmse_m: float | None = None,
    duration_s: float = 9.0,
    robot_time_s: float = 8.0,
    planning_time_s: float = 0.1,
) -> ActionResult:
    """One action: the first grasps node 30, others node 7, and each moves the tool by 1 m."""
    return ActionResult(
        action=action,
        kind=kind,
        grasp_node=30 if action == 1 else 7,
        grasp_ok=grasp_ok,
        rmse_m=rmse_m,
        predicted_rmse_m=predicted_rmse_m,
        true_rmse_m=true_rmse_m,
        duration_s=duration_s,
        robot_time_s=robot_time_s,
        path_length_m=1.0,
        planning_time_s=planning_time_s,
    )


PROTECTED = ArmProtection(
    stamp_ns=25_000_000,
    seq=1,
    robot="first",
    recovered=True,
    torque_nm=20.0,
    force_n=30.0,
    load_kg=0.25,
    load_at_m=np.array([0.0, 0.0, 0.1034]),
    reported_load_kg=0.25,
    reported_tool_kg=0.73,
    T_flange_tool=pose([0.0, 0.0, 0.1034], [0.924, 0.0, 0.0, -0.383]),
)
"""What a driver has set on a real arm after a recovery."""


def made_run(
    history: tuple[ActionResult, ...],
    *,
    outcome: RunOutcome = RunOutcome.CONVERGED,
    rmse_m: float = 0.01,
    true_rmse_m: float | None = None,
    threshold_m: float = 0.012,
    sim_time_s: float = 30.0,
) -> RunResult:
    """A run of these actions, 20 s of machine time long."""
    return RunResult(
        outcome=outcome,
        actions=len(history),
        rmse_m=rmse_m,
        true_rmse_m=true_rmse_m,
        threshold_m=threshold_m,
        seed=4,
        sim_time_s=sim_time_s,
        wall_time_s=20.0,
        planning_time_s=0.5,
        history=history,
        config_hash="0123456789ab",
        version="0.1.0",
    )


def made_record(
    nodes_world: Float64Array,
    *,
    release_stamp_ns: int | None = None,
    expected_world: Float64Array | None = None,
    path_world: Float64Array | None = None,
) -> ActionRecord:
    """The decision layer's record of an action that ended in a shape (M, 3) [m]."""
    return ActionRecord(
        action=1,
        kind="drag",
        grasp_node=0,
        grasp_ok=True,
        rmse_m=0.0,
        predicted_rmse_m=None,
        duration_s=1.0,
        robot_time_s=1.0,
        path_length_m=0.1,
        planning_time_s=0.1,
        release_stamp_ns=release_stamp_ns,
        nodes_world=nodes_world,
        expected_world=expected_world,
        path_world=path_world,
    )
