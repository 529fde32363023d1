"""The table of topics: one row for each published message; other packages add theirs by entry points `dlokit.topics`.

The cell's true DLO state is on no topic; a test verifies this.
"""

from functools import cache
from typing import Any, cast

from dlokit.communication.strategies import rows_from_packages
from dlokit.communication.topic import Every, KeepLast, Topic
from dlokit.types.action import Action, Candidates
from dlokit.types.dlo import DloBelief, DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import FlowStatus, GoalFrames, OperatorCommand, RunStatus
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.observation import CameraView, GraspState, Observation, ObserverEvent
from dlokit.types.robot import ArmProtection, RobotState
from dlokit.types.system import ClockTick, Heartbeat, StrategyChosen, ViewerPage

LAST = KeepLast()
ANY_ACTION = cast(type[Action], Action)  # a union decodes like a type, which the type system cannot express

# fmt: off
CLOCK         = Topic("cell/clock",        ClockTick,       "cell",       100.0, LAST,       "the cell's time")
ARM_STATE     = Topic("cell/arm_state",    RobotState,      "cell",       50.0,  LAST,       "the simulated arm's sensors")
ROBOT_STATE   = Topic("robot/state",       RobotState,      "robot",      50.0,  LAST,       "joints, tool pose, fingers; more often without a cell's arm")
PROTECTION    = Topic("robot/protection",  ArmProtection,   "robot",      None,  Every(16),  "what was set on a real arm")
STEREO_IMAGES = Topic("perception/images", StereoImages,    "perception", None,  LAST,       "the newest stereo pair")
DEPTH_IMAGES  = Topic("perception/depth",  DepthImage,      "perception", None,  LAST,       "the newest colour image with depth")
OBSERVATION   = Topic("perception/cloud",  Observation,     "perception", None,  Every(4),   "the DLO's point cloud")
CAMERA        = Topic("perception/camera", CameraView,      "perception", None,  LAST,       "the camera of the newest look, its pose corrected")
SEGMENTATION  = Topic("perception/segmentation", StrategyChosen, "perception", None, LAST, "the segmentation after a change by a call")
TARGETS       = Topic("observer/targets",  TargetPoints,    "observer",   None,  Every(4),   "estimated node positions")
OBSERVER_EVENT = Topic("observer/events",  ObserverEvent,   "observer",   None,  Every(16),  "the DLO was lost or found again")
STATE         = Topic("model/state",       DloState,        "model",      None,  Every(16),  "the estimated shape of the DLO")
GOAL          = Topic("model/goal",        GoalShape,       "model",      None,  LAST,       "the shape the operator wants")
BELIEF        = Topic("model/belief",      DloBelief,       "model",      None,  LAST,       "estimated DLO parameters, with uncertainty")
CANDIDATES    = Topic("planning/candidates", Candidates,    "planning",   None,  LAST,       "progress of planning, best candidates so far")
ACTION        = Topic("planning/action",   ANY_ACTION,      "planning",   None,  LAST,       "the grasp and path chosen")
GOAL_VERDICT  = Topic("planning/verdict",  GoalVerdict,     "planning",   None,  LAST,       "whether the goal can be reached and will hold")
GRIPPED       = Topic("decision/gripped",  GraspState,      "decision",   None,  Every(16),  "which node the gripper holds")
FLOW          = Topic("decision/flow",     FlowStatus,      "decision",   None,  Every(64),  "the step of the flow chart that runs")
RUN           = Topic("decision/run",      RunStatus,       "decision",   None,  LAST,       "what the run waits for, and how its last task ended")
HEARTBEAT     = Topic("decision/heartbeat", Heartbeat,      "decision",   25.0,  LAST,       "the commander of the robots is alive")
COMMAND       = Topic("viewer/command",    OperatorCommand, "viewer",     None,  Every(16),  "the operator's buttons")
GOAL_FRAMES   = Topic("viewer/frames",     GoalFrames,      "viewer",     None,  LAST,       "the frames that pull the goal")
VIEWER_PAGE   = Topic("viewer/page",       ViewerPage,      "viewer",     None,  LAST,       "URL of the viewer")
# fmt: on

TOPICS: tuple[Topic[Any], ...] = tuple(row for row in list(globals().values()) if isinstance(row, Topic))
"""dlokit's topics."""


@cache
def all_topics() -> tuple[Topic[Any], ...]:
    """dlokit's topics, then the topics that other packages add."""
    return (*TOPICS, *rows_from_packages("dlokit.topics", Topic, (topic.name for topic in TOPICS)))
