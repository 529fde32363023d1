"""A run as ROS 2 sees it: turns dlokit's messages into those to publish, live and from a recording."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.topic import Topic
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.scene import Scene
from dlokit.extras.ros2.definitions import Definitions
from dlokit.extras.ros2.published import markers, outgoing
from dlokit.extras.ros2.published.diagnostics import Diagnosis, diagnostic_array, run_diagnosis, status_message
from dlokit.extras.ros2.published.outgoing import Outgoing, Published
from dlokit.types.action import Action, ActionBase
from dlokit.types.dlo import DloBelief, DloState, GoalShape
from dlokit.types.flow import FlowStatus, RunStatus
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.message import Message
from dlokit.types.observation import CameraView, GraspState, Observation, ObserverEvent, ObserverEventKind
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

USUAL_RADIUS_M = 0.004
"""Radius with which a DLO is drawn before its belief is known [m]."""
_HERE = geometry.pose((0.0, 0.0, 0.0))


class RosView:
    """Knows of a run only the messages that it was fed, and answers each with the ROS messages to publish.

    The camera is in ``/tf_static``, and published there again when perception corrects its pose: the camera has not
    moved, the better pose holds for earlier pictures as well, and a late subscriber gets it at once. In ``/tf`` it
    would have to be repeated, and pictures between two corrections would wait for the next one.
    """

    reads: ClassVar[tuple[Topic[Any], ...]] = (
        topics.BELIEF,
        topics.STATE,
        topics.GOAL,
        topics.ACTION,
        topics.GRIPPED,
        topics.OBSERVATION,
        topics.OBSERVER_EVENT,
        topics.ROBOT_STATE,
        topics.FLOW,
        topics.RUN,
        topics.CAMERA,
        topics.STEREO_IMAGES,
        topics.DEPTH_IMAGES,
    )
    """Topics whose messages it takes, of every component instance; it ignores all others."""

    def __init__(
        self,
        ros: Definitions,
        ros_ns: Callable[[int], int],
        *,
        scene: Scene,
        frame: str = outgoing.BASE,
        wanted: Callable[[Published], bool] = lambda row: True,
    ) -> None:
        """`ros_ns` converts stamps of the run's clock to ROS time [ns]; `frame` is that of the base of the first arm.

        `scene` is the believed one, with the arms of the run. Messages of rows that are made on demand are made where
        `wanted` says so.
        """
        self.ros = ros
        """Definitions of the distribution for which messages are made; set again when another node connects."""
        self._ros_ns, self._wanted = ros_ns, wanted
        self._rows = {topic.row for topic in self.reads}
        arms = scene.arms
        self._joints = joint_names(arms)
        first = arms[0].T_world_base if arms else None
        self._frames = {(frame, outgoing.WORLD): _HERE if first is None else geometry.inverse(first)}
        self._camera_corrected = False
        self._markers = markers.Markers(ros)
        self._markers.show(markers.workspaces(ros, [arm.workspace for arm in arms]), ["workspace"])
        self._markers.show(markers.fixtures(ros, scene), ["fixtures"])
        self._radius_m = USUAL_RADIUS_M
        self._held: dict[str, int | None] = {}
        self._robots: dict[str, RobotState] = {}
        self._goal: GoalShape | None = None
        self._action: Action | None = None
        self._actions_before: int | None = None
        self._flow: FlowStatus | None = None
        self._run: RunStatus | None = None
        self._lost = False
        self._said: Diagnosis | None = None

    def lasting(self, stamp_ns: int) -> list[Outgoing]:
        """The messages of all transient-local topics as they are now, for a node that has just connected."""
        stamp = self._ros_ns(stamp_ns)
        goal = [] if self._goal is None else self._goal_messages(self._goal)
        return [self._transforms(stamp), self._marker_array(stamp), *goal, self._status()]

    def on(self, topic: Topic[Any], message: Message) -> list[Outgoing]:
        """Take a message of a topic; returns what is to be published now."""
        if topic.row not in self._rows:
            return []
        if isinstance(message, StereoImages | DepthImage | CameraView):
            found = self._camera(message)
        elif isinstance(message, RobotState):
            found = self._joint_states(message)
        elif isinstance(message, FlowStatus | RunStatus | ActionBase | ObserverEvent):
            found = self._progress(message)
        else:
            found = self._shapes(message)
        return found + self._changed_status()

    def diagnosis(self) -> Diagnosis:
        """The status of the run."""
        return run_diagnosis(
            flow=self._flow,
            run=self._run,
            action=self._action,
            robots=tuple(self._robots.values()),
            lost=self._lost,
        )

    def diagnostics(self, stamp_ns: int, link: Sequence[Diagnosis] = ()) -> Outgoing:
        """The status of the run, and those of the link, for ``/diagnostics``; to be called each second."""
        message = diagnostic_array(self.ros, self._ros_ns(stamp_ns), (self.diagnosis(), *link))
        return Outgoing(row=outgoing.DIAGNOSTICS, message=message)

    def _shapes(self, message: Message) -> list[Outgoing]:
        stamp = self._ros_ns(message.stamp_ns)
        match message:
            case DloBelief():
                self._radius_m = message.radius_m.value
            case GraspState():
                self._held[message.robot] = message.node
            case DloState():
                return self._state_messages(message, stamp)
            case GoalShape():
                self._goal = message
                shown = markers.rod(self.ros, markers.GOAL, message.nodes_world, self._radius_m)
                self._markers.show(shown, ["goal"])
                return [*self._goal_messages(message), self._marker_array(stamp)]
            case Observation():
                cloud = outgoing.seen_cloud(self.ros, stamp, message.points_world)
                return [Outgoing(row=outgoing.CLOUD, message=cloud)]
            case _:
                pass
        return []

    def _state_messages(self, state: DloState, stamp: int) -> list[Outgoing]:
        held = [node for node in self._held.values() if node is not None]
        shown = markers.rod(self.ros, markers.STATE, state.nodes_world, self._radius_m)
        self._markers.show(shown, ["state"])
        return [
            Outgoing(row=outgoing.DLO, message=outgoing.dlo_cloud(self.ros, stamp, state, held)),
            Outgoing(row=outgoing.POSES, message=outgoing.pose_array(self.ros, stamp, state.nodes_world)),
            self._marker_array(stamp),
        ]

    def _goal_messages(self, goal: GoalShape) -> list[Outgoing]:
        path = outgoing.goal_path(self.ros, self._ros_ns(goal.stamp_ns), goal.nodes_world)
        return [Outgoing(row=outgoing.GOAL, message=path)]

    def _progress(self, message: FlowStatus | RunStatus | ActionBase | ObserverEvent) -> list[Outgoing]:
        match message:
            case RunStatus():
                self._run = message
            case ObserverEvent():
                if message.kind is not ObserverEventKind.REFUSED:
                    self._lost = message.kind is ObserverEventKind.LOST
            case FlowStatus():
                self._flow = message
                if self._actions_before is None:
                    self._actions_before = message.actions
                if self._action is not None and self._has_ended(self._action, message):
                    return self._show_action(None, message.stamp_ns)
            case _:
                self._actions_before = None if self._flow is None else self._flow.actions
                if self._flow is None or not self._has_ended(message, self._flow):
                    return self._show_action(message, message.stamp_ns)
        return []

    def _has_ended(self, action: ActionBase, flow: FlowStatus) -> bool:
        """Whether an action has been made, or belongs to a task that has ended; a new task counts actions from 0."""
        ended = flow.outcome is not None and action.stamp_ns <= flow.stamp_ns
        return ended or flow.actions != self._actions_before

    def _show_action(self, action: Any, stamp_ns: int) -> list[Outgoing]:
        """Show an action, or none, in place of the one before."""
        self._action = action
        shown = {} if action is None else markers.action_markers(self.ros, action, self._radius_m)
        self._markers.show(shown, markers.ACTION_NAMESPACES)
        return [self._marker_array(self._ros_ns(stamp_ns))]

    def _joint_states(self, state: RobotState) -> list[Outgoing]:
        self._robots[state.robot] = state
        names = self._joints.get(state.robot)
        if names is None or not self._wanted(outgoing.JOINTS):
            return []
        message = outgoing.joint_state(self.ros, self._ros_ns(state.stamp_ns), names, state)
        return [Outgoing(row=outgoing.JOINTS, message=message)]

    def _camera(self, message: StereoImages | DepthImage | CameraView) -> list[Outgoing]:
        """The pictures that are wanted, after the pose of their camera where it is new."""
        stamp = self._ros_ns(message.stamp_ns)
        found = self._camera_frame(message, stamp)
        if isinstance(message, CameraView):
            return found
        camera, ros = message.calibration, self.ros
        if isinstance(message, StereoImages):
            made: list[tuple[Published, Callable[[], Any]]] = [
                (outgoing.LEFT, lambda: outgoing.image(ros, stamp, message.left)),
                (outgoing.LEFT_INFO, lambda: outgoing.camera_info(ros, stamp, camera)),
                (outgoing.RIGHT, lambda: outgoing.image(ros, stamp, message.right)),
                (outgoing.RIGHT_INFO, lambda: outgoing.camera_info(ros, stamp, camera, 1)),
            ]
        else:
            made = [
                (outgoing.COLOUR, lambda: outgoing.image(ros, stamp, message.pixels)),
                (outgoing.COLOUR_INFO, lambda: outgoing.camera_info(ros, stamp, camera)),
                (outgoing.DEPTHS, lambda: outgoing.depth_image(ros, stamp, message.depth_m)),
                (outgoing.DEPTHS_INFO, lambda: outgoing.camera_info(ros, stamp, camera)),
            ]
        return found + [Outgoing(row=row, message=make()) for row, make in made if self._wanted(row)]

    def _camera_frame(self, message: StereoImages | DepthImage | CameraView, stamp: int) -> list[Outgoing]:
        """The transforms, where the pose of the camera is new; perception's pose counts before the calibrated one."""
        corrected = isinstance(message, CameraView)
        if self._camera_corrected and not corrected:
            return []
        self._camera_corrected |= corrected
        key, pose = (outgoing.WORLD, outgoing.CAMERA), message.calibration.T_world_camera
        if key in self._frames and _same(self._frames[key], pose):
            return []
        self._frames[key] = pose
        return [self._transforms(stamp)]

    def _transforms(self, stamp: int) -> Outgoing:
        return Outgoing(row=outgoing.TF_STATIC, message=outgoing.transforms(self.ros, stamp, self._frames))

    def _marker_array(self, stamp: int) -> Outgoing:
        return Outgoing(row=outgoing.MARKERS, message=self._markers.array(stamp))

    def _changed_status(self) -> list[Outgoing]:
        return [] if self.diagnosis() == self._said else [self._status()]

    def _status(self) -> Outgoing:
        self._said = self.diagnosis()
        return Outgoing(row=outgoing.STATUS, message=status_message(self.ros, self._said))


def joint_names(arms: Sequence[ArmMount]) -> dict[str, tuple[str, ...]]:
    """The names of the joints of each arm, by its name; those of all but the first begin with the arm's name."""
    return {
        arm.robot: tuple(f"{arm.robot}_{joint.name}" if number else joint.name for joint in arm.model.joints)
        for number, arm in enumerate(arms)
    }


def _same(one: Pose, other: Pose) -> bool:
    return np.array_equal(one.position_m, other.position_m) and np.array_equal(one.wxyz, other.wxyz)
