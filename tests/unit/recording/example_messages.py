"""A message of every recorded type, with values that JSON does not support."""

import numpy as np
from made_results import PROTECTED

from dlokit.communication import topics
from dlokit.recording.channels import CALLS_BEGUN, SKILL_CALLS
from dlokit.types.action import Candidates, Grasp, PickPlace, ScoredCandidate, VelocityProfile
from dlokit.types.dlo import DloBelief, DloState, GoalShape, LogNormal, TargetPoints, Topology
from dlokit.types.feasibility import Finding, GoalVerdict, Problem, Standing
from dlokit.types.flow import (
    Command,
    FlowStatus,
    GoalFrame,
    GoalFrames,
    Mode,
    OperatorCommand,
    RunOutcome,
    RunPhase,
    RunStatus,
    TaskEnd,
)
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages
from dlokit.types.message import Message
from dlokit.types.observation import (
    CameraView,
    DistrustReason,
    GraspState,
    GripperPin,
    Observation,
    ObserverEvent,
    ObserverEventKind,
    Occlusion,
)
from dlokit.types.outcome import CallBegun, CallEnd, CallRecord
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotMode, RobotState
from dlokit.types.system import ClockTick, Heartbeat, StrategyChosen, StrategySpec, ViewerPage

RNG = np.random.default_rng(5)
NODES = 31
POINTS = 700  # too many to be listed

POSE = Pose(position_m=RNG.normal(size=3), wxyz=np.array([0.0, 1.0, 0.0, 0.0]))
CALIBRATION = CameraCalibration(
    width_px=16,
    height_px=8,
    fx_px=10.0,
    fy_px=10.0,
    cx_px=8.0,
    cy_px=4.0,
    T_world_camera=POSE,
    baseline_m=0.1,
    distortion=np.zeros(5, dtype=np.float32),
)
PIXELS = np.full((8, 16, 3), (200, 30, 90), dtype=np.uint8)
ROBOT = RobotState(
    stamp_ns=20_000_000,
    seq=1,
    robot="first",
    q_rad=RNG.normal(size=7),
    dq_rad_s=np.array([0.1, 1 / 3, -0.0, 1e-300, 1e300, np.pi, 0.0]),
    tau_nm=np.array([np.nan, np.inf, -np.inf, 0.0, 0.0, 0.0, 0.0]),
    T_world_tcp=POSE,
    finger_width_m=0.04,
    mode=RobotMode.MOVING,
)

EXAMPLES: dict[str, Message] = {
    topics.CLOCK.name: ClockTick(stamp_ns=10_000_000, seq=1, real_time_factor=float("inf")),
    topics.ARM_STATE.name: ROBOT,
    topics.ROBOT_STATE.name: ROBOT,
    topics.PROTECTION.name: PROTECTED,
    topics.STEREO_IMAGES.name: StereoImages(
        stamp_ns=30_000_000, seq=1, left=PIXELS, right=PIXELS[:, ::-1].copy(), calibration=CALIBRATION
    ),
    topics.DEPTH_IMAGES.name: DepthImage(
        stamp_ns=30_000_000,
        seq=1,
        pixels=PIXELS,
        depth_m=np.tile(np.array([0.0, 0.357, 1.002, 6.0], dtype=np.float32), (8, 4)),
        calibration=CALIBRATION,
    ),
    topics.OBSERVATION.name: Observation(
        stamp_ns=30_000_000,
        seq=1,
        points_world=RNG.normal(size=(POINTS, 3)).astype(np.float32),
        calibration=CALIBRATION,
        occlusion=Occlusion(depth_m=np.full((2, 4), np.inf, dtype=np.float32), scale=4),
        pins=(GripperPin(robot="first", node=3, position_world=np.ones(3, dtype=np.float32)),),
    ),
    topics.CAMERA.name: CameraView(stamp_ns=30_000_000, seq=1, calibration=CALIBRATION),
    topics.TARGETS.name: TargetPoints(
        stamp_ns=30_000_000,
        seq=1,
        nodes_world=RNG.normal(size=(NODES, 3)),
        visible=RNG.random(NODES) < 0.5,
        covariance=RNG.normal(size=(NODES, 3, 3)),
    ),
    topics.OBSERVER_EVENT.name: ObserverEvent(
        stamp_ns=30_000_000, seq=1, kind=ObserverEventKind.LOST, reason=DistrustReason.NO_POINTS, health=0.0
    ),
    topics.STATE.name: DloState(
        stamp_ns=40_000_000,
        seq=1,
        nodes_world=RNG.normal(size=(NODES, 3)),
        topology=Topology(edges=np.array([[0, 1], [1, 2]]), rest_lengths_m=np.array([0.1, 0.2])),
        tracking_error_m=float("nan"),
    ),
    topics.GOAL.name: GoalShape(stamp_ns=40_000_000, seq=1, nodes_world=np.empty((0, 3)), name="leer"),
    topics.BELIEF.name: DloBelief(
        stamp_ns=45_000_000,
        seq=1,
        length_m=LogNormal(value=0.5, log_sd=0.01),
        radius_m=LogNormal(value=0.004),
        bending_stiffness_n_m2=LogNormal(value=1.3e-5, log_sd=0.3),
        weight_n_m=LogNormal(value=0.34, log_sd=0.2),
        friction=LogNormal(value=0.6, log_sd=0.25),
        elastic_m3=LogNormal(value=6.4e-5, log_sd=0.2),
        yield_curvature_1_m=None,
        actions=3,
    ),
    topics.CANDIDATES.name: Candidates(
        stamp_ns=50_000_000,
        seq=1,
        rollouts=40,
        budget=480,
        best=(
            ScoredCandidate(
                kind="drag",
                node=4,
                score_m=0.012,
                nodes_world=RNG.normal(size=(NODES, 3)),
                path_world=RNG.normal(size=(5, 3)),
            ),
        ),
    ),
    topics.ACTION.name: PickPlace(
        stamp_ns=50_000_000,
        seq=1,
        grasp=Grasp(node=4, T_world_tcp=POSE),
        path=(POSE, POSE),
        velocity=VelocityProfile(),
        predicted_nodes_world=RNG.normal(size=(NODES, 3)),
    ),
    topics.GOAL_VERDICT.name: GoalVerdict(
        stamp_ns=40_000_000,
        seq=1,
        standing=Standing.DOUBTFUL,
        threshold_m=0.012,
        goal_world=RNG.normal(size=(NODES, 3)),
        findings=(
            Finding(problem=Problem.SPRINGS_BACK, node=4, amount=0.02, limit=0.01, unit="m", text="It springs back."),
        ),
    ),
    topics.GRIPPED.name: GraspState(stamp_ns=50_000_000, seq=1, robot="first", node=None),
    topics.FLOW.name: FlowStatus(
        stamp_ns=60_000_000,
        seq=1,
        flow="shape_dlo",
        step="converged",
        rmse_m=0.01,
        outcome=RunOutcome.CONVERGED,
        mode=Mode.PLANNING,
    ),
    topics.HEARTBEAT.name: Heartbeat(stamp_ns=60_000_000, seq=1, holder="a1b2"),
    topics.RUN.name: RunStatus(
        stamp_ns=5,
        seq=1,
        phase=RunPhase.WAITING,
        task=2,
        stays=True,
        last=TaskEnd(
            number=2,
            goal="S",
            outcome=RunOutcome.CONVERGED,
            text="The DLO has reached the goal shape.",
            actions=3,
            rmse_m=None,
            threshold_m=0.012,
            folder="runs/1",
            files=("task-2/report.html",),
        ),
    ),
    topics.COMMAND.name: OperatorCommand(stamp_ns=60_000_000, seq=1, command=Command.PAUSE),
    topics.GOAL_FRAMES.name: GoalFrames(stamp_ns=60_000_000, seq=1, frames=(GoalFrame(node=3, x_m=0.5, y_m=0.0),)),
    topics.SEGMENTATION.name: StrategyChosen(
        stamp_ns=60_000_000, seq=1, spec=StrategySpec(name="brightness", settings=b'{"threshold":3}')
    ),
    topics.VIEWER_PAGE.name: ViewerPage(stamp_ns=60_000_000, seq=1, url="http://127.0.0.1:8080"),
    CALLS_BEGUN.name: CallBegun(stamp_ns=65_000_000, seq=1, skill="robot.stop", call=1, caller="memory"),
    SKILL_CALLS.name: CallRecord(stamp_ns=70_000_000, seq=1, skill="robot.stop", outcome=CallEnd.SUCCEEDED),
}
