"""The viewer: shows the published messages, and lets the operator shape a goal and start the task."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import viser

from dlokit.communication import topics
from dlokit.communication.component import Component, on
from dlokit.communication.skill import Skill
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.shapes import builtin_shape
from dlokit.description.table import TABLE_X_M, TABLE_Y_M, Table
from dlokit.skills.viewer.address import new_key, page_url, watch_key
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.flow_chart import Edge
from dlokit.skills.viewer.frames import GoalFramesView, GoalHandles
from dlokit.skills.viewer.page import LoopGate, close_page, open_page
from dlokit.skills.viewer.panel import Operator, Panel
from dlokit.skills.viewer.scene import PICTURE_WIDTH_PX, ViewerScene, thumbnail
from dlokit.skills.viewer.state import ActiveStep, ErrorHistory, Newest, RunState, after_command, after_status
from dlokit.types.action import Action, Candidates
from dlokit.types.dlo import DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import Command, FlowStatus, OperatorCommand
from dlokit.types.image import CameraPictures, DepthImage, StereoImages
from dlokit.types.observation import Observation, ObserverEvent
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState
from dlokit.types.system import ViewerPage

_DRAW_PERIOD_S = 1.0 / 15.0
"""Time between two updates of the scene [s]; nothing is drawn while no browser is open."""


@dataclass(frozen=True, kw_only=True)
class RodOutline:
    """Nodes and size of the rod, for drawing before the first state arrives."""

    nodes: int
    """Nodes of the model."""
    length_m: float
    radius_m: float


@dataclass(frozen=True, kw_only=True)
class ArmButtons:
    """The skills that stop and enable one arm, called directly: the decision process may be frozen."""

    stop: Skill[[], None]
    enable: Skill[[], None]


class ViewerComponent(Component):
    """Serves the page while it runs. Handlers keep the newest message of each topic; `run` draws new ones."""

    name = "viewer"
    publishes = (topics.COMMAND, topics.GOAL_FRAMES, topics.VIEWER_PAGE)

    def __init__(
        self,
        config: ViewerConfig,
        *,
        flow: Sequence[Edge],
        rod: RodOutline,
        table: Table,
        arms: tuple[ArmMount, ...],
        threshold_m: float,
        T_world_installation: Pose | None = None,
        operated: bool = True,
        buttons: tuple[ArmButtons, ...] = (),
        key: str | None = None,
    ) -> None:
        """`flow` is the flow chart's table: (step, outcome, next) of every arrow; `table` is the believed one, `arms`
        are those of the run. `T_world_installation` is the frame of the installation, where it is not the world's.

        Without `operated` the page has neither buttons nor frames to drag: in a replay they would have no effect.
        Every owner of `key` may open the page and operate; None: a new key.
        """
        super().__init__()
        self._config = config
        self._flow = tuple(flow)
        self._rod = rod
        self._table = table
        self._arms = arms
        self._T_world_installation = T_world_installation
        self._threshold_m = threshold_m
        self._operated = operated
        self._buttons = buttons
        self._calls: set[asyncio.Task[Any]] = set()
        self._key = new_key() if key is None else key
        self._port = config.port
        self.opened = asyncio.Event()
        """Set while the page is served."""
        self._run_state = RunState.WAITING
        self._history = ErrorHistory()
        self._active_step = ActiveStep(self._flow)
        self._handles = GoalHandles(
            builtin_shape("I", rod.length_m, rod.nodes, radius_m=rod.radius_m), TABLE_X_M, TABLE_Y_M
        )
        self._images = Newest[CameraPictures]()
        self._cloud = Newest[Observation]()
        self._targets = Newest[TargetPoints]()
        self._event = Newest[ObserverEvent]()
        self._state = Newest[DloState]()
        self._goal = Newest[GoalShape]()
        self._robots: dict[str, Newest[RobotState]] = {}
        self._action = Newest[Action]()
        self._candidates = Newest[Candidates]()
        self._verdict = Newest[GoalVerdict]()
        self._status = Newest[FlowStatus]()

    @property
    def url(self) -> str:
        """Address of the page with its key; with port 0 it is known once `opened` is set."""
        return page_url(self._config.host, self._port, self._key)

    @property
    def watch_url(self) -> str:
        """Address of the same page for people who may look and not operate."""
        return page_url(self._config.host, self._port, watch_key(self._key))

    async def run(self) -> None:
        """Serve the page and draw, until cancelled. Raises `MachineError` as `open_page` does."""
        server = open_page(self._config.host, self._config.port, self._key)
        gate = LoopGate(asyncio.get_running_loop())
        try:
            self._port = server.get_port()
            scene = ViewerScene(server, self._table, self._rod.radius_m, self._arms, self._T_world_installation)
            frames = GoalFramesView(server, self._handles, gate, self._publish_frames) if self._operated else None
            panel = Panel(
                server,
                gate,
                flow=self._flow,
                threshold_m=self._threshold_m,
                operator=None if frames is None else self._operator(frames),
                watch_url=self.watch_url,
                set_visible=scene.set_visible,
            )
            self.opened.set()
            self.port.publish(topics.VIEWER_PAGE, ViewerPage(stamp_ns=self.port.clock.now_ns(), url=self.url))
            await self._draw_for_ever(server, scene, frames, panel)
        finally:
            self.opened.clear()
            gate.shut()
            close_page(server)

    @on(topics.ROBOT_STATE)
    async def on_robot_state(self, state: RobotState) -> None:
        """Keep the newest state of each robot."""
        self._robots.setdefault(state.robot, Newest()).put(state)

    @on(topics.STEREO_IMAGES)
    async def on_images(self, images: StereoImages) -> None:
        """Keep the newest message."""
        self._images.put(images)

    @on(topics.DEPTH_IMAGES)
    async def on_depth_image(self, image: DepthImage) -> None:
        """Keep the newest message."""
        self._images.put(image)

    @on(topics.OBSERVATION)
    async def on_observation(self, seen: Observation) -> None:
        """Keep the newest message."""
        self._cloud.put(seen)

    @on(topics.TARGETS)
    async def on_targets(self, targets: TargetPoints) -> None:
        """Keep the newest message."""
        self._targets.put(targets)

    @on(topics.OBSERVER_EVENT)
    async def on_observer_event(self, event: ObserverEvent) -> None:
        """Keep the newest message."""
        self._event.put(event)

    @on(topics.STATE)
    async def on_state(self, state: DloState) -> None:
        """Keep the newest message."""
        self._state.put(state)

    @on(topics.GOAL)
    async def on_goal(self, goal: GoalShape) -> None:
        """Keep the newest goal; the frames follow it until the operator drags one."""
        self._goal.put(goal)
        self._handles.follow(goal.nodes_world)

    @on(topics.GOAL_VERDICT)
    async def on_goal_verdict(self, verdict: GoalVerdict) -> None:
        """Keep the newest message."""
        self._verdict.put(verdict)

    @on(topics.CANDIDATES)
    async def on_candidates(self, candidates: Candidates) -> None:
        """Keep the newest message."""
        self._candidates.put(candidates)

    @on(topics.ACTION)
    async def on_action(self, action: Action) -> None:
        """Keep the newest message."""
        self._action.put(action)

    @on(topics.FLOW)
    async def on_flow(self, status: FlowStatus) -> None:
        """Keep the newest status, and the error of each."""
        self._run_state = after_status(self._run_state, status)
        self._history.record(status)
        self._active_step.record(status)
        self._status.put(status)

    async def _draw_for_ever(
        self, server: viser.ViserServer, scene: ViewerScene, frames: GoalFramesView | None, panel: Panel
    ) -> None:
        # The page runs on this process's clock: it must answer while the cell's clock pauses.
        clock = LoopClock()
        while True:
            # New messages are kept without a client, and drawn for the first one.
            if server.get_clients():
                with server.atomic():
                    self._draw_scene(scene, frames)
                    self._draw_panel(scene, panel)
            await clock.sleep(_DRAW_PERIOD_S)

    def _draw_scene(self, scene: ViewerScene, frames: GoalFramesView | None) -> None:
        for robot in self._robots.values():
            robot.take(scene.show_robot)
        self._cloud.take(scene.show_cloud)
        self._targets.take(scene.show_targets)
        self._state.take(scene.show_state)
        if (candidates := self._candidates.value) is not None and self._candidates.fresh:
            scene.show_candidates(candidates)
        self._action.take(scene.show_action)
        if (verdict := self._verdict.value) is not None and self._verdict.fresh:
            scene.show_verdict(verdict)
        if self._goal.take(scene.show_goal) and frames is not None and not self._handles.dragged:
            frames.place()

    def _draw_panel(self, scene: ViewerScene, panel: Panel) -> None:
        if (images := self._images.value) is not None and self._images.fresh:
            panel.draw_picture(thumbnail(images.reference, PICTURE_WIDTH_PX))
        self._images.take(scene.show_pictures)
        self._event.take(panel.draw_observer_event)
        self._candidates.take(panel.draw_candidates)
        if (status := self._status.value) is not None and self._status.fresh and status.outcome is not None:
            scene.hide_action()
            scene.hide_candidates(0)
        self._verdict.take(panel.draw_verdict)
        panel.draw_stop(any(robot.value is not None and robot.value.stop_latched for robot in self._robots.values()))
        self._status.take(lambda status: panel.draw_status(self._run_state, status, self._active_step, self._history))

    def _operator(self, frames: GoalFramesView) -> Operator:
        return Operator(
            command=self._publish_command,
            shape_it=self._shape_it,
            reset_frames=lambda: self._reset_frames(frames),
            enable=lambda: self._call_arms([arm.enable for arm in self._buttons]),
        )

    def _publish_frames(self) -> None:
        self.port.publish(topics.GOAL_FRAMES, self._handles.message(self.port.clock.now_ns()))

    def _publish_command(self, command: Command) -> None:
        self._run_state = after_command(self._run_state, command)
        self._status.again()
        if command is Command.STOP:
            self._call_arms([arm.stop for arm in self._buttons])
        self.port.publish(topics.COMMAND, OperatorCommand(stamp_ns=self.port.clock.now_ns(), command=command))

    def _call_arms(self, skills: Sequence[Skill[[], None]]) -> None:
        for skill in skills:
            call = asyncio.create_task(self.port.call(skill), name=f"viewer calls {skill.key}")
            self._calls.add(call)
            call.add_done_callback(self._calls.discard)

    def _shape_it(self) -> None:
        # Publish the frames again before the start: a component that missed the drag gets the operator's goal.
        self._publish_frames()
        self._publish_command(Command.START)

    def _reset_frames(self, frames: GoalFramesView) -> None:
        self._handles.release()
        frames.place()
        self._publish_frames()
