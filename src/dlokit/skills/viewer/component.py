"""The viewer: shows the published messages, and lets the operator shape a goal and start the task."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeVar

import viser

from dlokit.communication import topics
from dlokit.communication.component import Component, on
from dlokit.communication.container import end_tasks
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topic import Topic
from dlokit.description.scene import Scene
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.goal.editor import GoalSkills, RodOutline
from dlokit.skills.viewer.operator_input import ArmButtons, OperatorInput
from dlokit.skills.viewer.panel.flow_chart import Edge
from dlokit.skills.viewer.panel.health import LOOK_EVERY_S, EventLog, Health, WatchedComponent
from dlokit.skills.viewer.panel.panel import Panel
from dlokit.skills.viewer.playback import Player
from dlokit.skills.viewer.scene import PICTURE_WIDTH_PX, ViewerScene, thumbnail, with_shapes
from dlokit.skills.viewer.segmentation import SegmentationTools, SegmentationTuner
from dlokit.skills.viewer.serving.address import RunFiles, new_key, page_url, watch_key
from dlokit.skills.viewer.serving.page import LoopGate, OpenPage, close_page, open_page
from dlokit.skills.viewer.state import Newest, Received
from dlokit.types.action import Candidates
from dlokit.types.arrays import UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import FlowStatus, RunPhase, RunStatus
from dlokit.types.image import CameraPictures
from dlokit.types.message import Message
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState
from dlokit.types.system import ViewerPage

T = TypeVar("T", bound=Message)

_DRAW_PERIOD_NS = round(1e9 / 30.0)
"""Time between two updates of the scene [ns]; nothing is drawn while no browser is open."""


def _keeps(
    topic: Topic[T], newest: Callable[[Received], Newest[Any]]
) -> Callable[["ViewerComponent", T], Coroutine[Any, Any, None]]:
    """A handler that keeps the newest message of a topic."""

    @on(topic)
    async def keep(self: "ViewerComponent", message: T) -> None:
        newest(self.seen).put(message)

    return keep


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
        scene: Scene,
        threshold_m: float,
        T_world_installation: Pose | None = None,
        operated: bool = True,
        player: Player | None = None,
        buttons: tuple[ArmButtons, ...] = (),
        goals: GoalSkills | None = None,
        watched: tuple[WatchedComponent, ...] = (),
        files: RunFiles | None = None,
        rejects_infeasible: bool = True,
        segmentation: SegmentationTools | None = None,
        key: str | None = None,
        opens: OpenPage = open_page,
    ) -> None:
        """`flow` is the flow chart's table: (step, outcome, next) of every arrow; `scene` is the believed one, with
        the arms of the run. `T_world_installation` is the frame of the installation if it is not the world frame.

        Without `operated` the page has neither buttons nor frames to drag, which would have no effect. With a `player`
        it shows a recorded run, with the timeline in their place.
        `goals` set and judge the goal; None: the goal cannot be changed. `watched` are the components whose health is
        shown; `files` of the run are served. `rejects_infeasible`: the run refuses a goal that cannot hold. With
        `segmentation` its settings can be changed on the page.
        Every owner of `key` may open the page and operate; None: a new key. `opens` opens the page.
        """
        super().__init__()
        self._config = config
        self._flow = tuple(flow)
        self._rod = rod
        self._around = scene
        self._T_world_installation = T_world_installation
        self._threshold_m = threshold_m
        self._player = player
        self._key = new_key() if key is None else key
        self._port = config.port
        self._opens = opens
        self.opened = asyncio.Event()
        """Set while the page is served."""
        self.visited = asyncio.Event()
        """Set once a browser has opened the page."""
        self._files = files
        self.seen = Received(self._flow)
        """The messages that the page shows."""
        self._forgot = False
        self._health = Health(watched)
        self._log = EventLog(self._time_text)
        self._tuner = None
        if segmentation is not None:
            self._tuner = SegmentationTuner(segmentation, self.seen, scene, lambda: self.port)
        self._operator: OperatorInput | None = None
        if operated and player is None:
            self._operator = OperatorInput(
                self.seen,
                self._health,
                rod,
                lambda: self.port,
                goals=goals,
                arms=buttons,
                threshold_m=threshold_m,
                rejects_infeasible=rejects_infeasible,
            )

    @property
    def url(self) -> str:
        """Address of the page with its key; with port 0 it is known once `opened` is set."""
        return page_url(self._config.host, self._port, self._key)

    @property
    def watch_url(self) -> str:
        """Address of the same page for people who may only watch."""
        return page_url(self._config.host, self._port, watch_key(self._key))

    async def run(self) -> None:
        """Serve the page and draw, until cancelled. Raises `MachineError` as `open_page` does."""
        server = self._opens(self._config.host, self._config.port, self._key, self._files)
        gate = LoopGate(asyncio.get_running_loop())
        looking = asyncio.create_task(self._watch_components(), name="health")
        try:
            self._port = server.get_port()
            scene = ViewerScene(server, self._around, self._rod.radius_m, self._T_world_installation)
            tools = self._player if self._operator is None else self._operator.add_to(server, gate)
            panel = Panel(
                server,
                gate,
                flow=self._flow,
                threshold_m=self._threshold_m,
                tools=tools,
                watch_url=self.watch_url,
                layers=_without_absent(palette.LAYERS, self._around),
                picture_layers=_without_absent(palette.PICTURE_LAYERS, self._around),
                set_visible=scene.set_visible,
                segmentation=self._tuner,
            )
            self.opened.set()
            self.port.publish(topics.VIEWER_PAGE, ViewerPage(stamp_ns=self.port.clock.now_ns(), url=self.url))
            await self._draw_for_ever(server, scene, panel)
        finally:
            self.opened.clear()
            gate.shut()
            await end_tasks(looking)
            if self._operator is not None:
                await self._operator.close()
            if self._tuner is not None:
                await self._tuner.close()
            close_page(server)

    @on(topics.ROBOT_STATE)
    async def on_robot_state(self, state: RobotState) -> None:
        """Keep the newest state of each robot."""
        self.seen.robots.setdefault(state.robot, Newest()).put(state)

    on_images = _keeps(topics.STEREO_IMAGES, lambda seen: seen.pictures)
    on_depth_image = _keeps(topics.DEPTH_IMAGES, lambda seen: seen.pictures)
    on_segmentation = _keeps(topics.SEGMENTATION, lambda seen: seen.segmentation)
    on_observation = _keeps(topics.OBSERVATION, lambda seen: seen.cloud)
    on_targets = _keeps(topics.TARGETS, lambda seen: seen.targets)
    on_observer_event = _keeps(topics.OBSERVER_EVENT, lambda seen: seen.event)
    on_state = _keeps(topics.STATE, lambda seen: seen.state)

    @on(topics.GOAL)
    async def on_goal(self, goal: GoalShape) -> None:
        """Keep the newest message."""
        self.seen.goal.put(goal)
        if self._operator is not None:
            self._operator.on_goal(goal)

    @on(topics.GOAL_VERDICT)
    async def on_goal_verdict(self, verdict: GoalVerdict) -> None:
        """Keep the newest message."""
        self.seen.verdict.put(verdict)
        if self._operator is not None:
            self._operator.on_verdict(verdict)

    @on(topics.CANDIDATES)
    async def on_candidates(self, candidates: Candidates) -> None:
        """Keep the newest message."""
        self.seen.record_candidates(candidates)

    on_action = _keeps(topics.ACTION, lambda seen: seen.action)

    @on(topics.RUN)
    async def on_run(self, status: RunStatus) -> None:
        """Keep the phase of the run and the end of its last task."""
        if (ended := self.seen.record_run(status)) is not None:
            self._log.add(f"task {ended.number} ended: {ended.outcome.value}", status.stamp_ns)
        self._log.add(status.notice, status.stamp_ns)

    @on(topics.FLOW)
    async def on_flow(self, status: FlowStatus) -> None:
        """Keep the newest status, and the error after each action."""
        self.seen.record_flow(status)
        self._log.add(f"{status.step.replace('_', ' ')}{f': {status.text}' if status.text else ''}", status.stamp_ns)

    def forget(self) -> None:
        """Forget all messages and clear the page, before the messages of another moment of a recorded run."""
        self.seen, self._forgot = Received(self._flow), True
        self._log = EventLog(self._time_text)

    def _time_text(self, stamp_ns: int) -> str:
        """The present time of day; in a recorded run, the time since its beginning."""
        if self._player is None:
            return time.strftime("%H:%M:%S")
        return f"{(stamp_ns - self._player.timeline.begin_ns) / 1e9:.1f} s"

    async def _watch_components(self) -> None:
        clock = LoopClock()
        while True:
            for change in self._health.look(self.port.alive):
                self._log.add(change, self.port.clock.now_ns())
            if self._tuner is not None:
                self._tuner.on_health(self._health.states)
            await clock.sleep(LOOK_EVERY_S)

    async def _draw_for_ever(self, server: viser.ViserServer, scene: ViewerScene, panel: Panel) -> None:
        # The page runs on this process's clock: it must answer while the cell's clock pauses.
        clock = LoopClock()
        next_ns = clock.now_ns()
        while True:
            if self._operator is not None:
                self._operator.judge()
            # New messages are kept without a client, and drawn for the first one.
            if server.get_clients():
                self.visited.set()
                with server.atomic():
                    self._clear(scene, panel)
                    self._draw_scene(scene)
                    self._draw_panel(scene, panel)
            # From deadline to deadline, so that the time of drawing does not lengthen the period.
            next_ns = max(next_ns + _DRAW_PERIOD_NS, clock.now_ns())
            await clock.sleep_until(next_ns)

    def _clear(self, scene: ViewerScene, panel: Panel) -> None:
        if self._forgot:
            self._forgot = False
            scene.clear()
            panel.clear()

    def _draw_scene(self, scene: ViewerScene) -> None:
        for robot in self.seen.robots.values():
            robot.take(scene.show_robot)
        self.seen.cloud.take(scene.show_cloud)
        self.seen.targets.take(scene.show_targets)
        self.seen.state.take(scene.show_state)
        if (candidates := self.seen.candidates.value) is not None and self.seen.candidates.is_new:
            scene.show_candidates(candidates)
        self.seen.action.take(scene.show_action)
        self.seen.verdict.take(scene.show_verdict)
        if self.seen.goal.take(scene.show_goal) and self._operator is not None:
            self._operator.place_frames()

    def _draw_panel(self, scene: ViewerScene, panel: Panel) -> None:
        if (images := self.seen.pictures.value) is not None and self.seen.pictures.is_new:
            panel.draw_picture(self._picture(images))
        self.seen.pictures.take(scene.show_pictures)
        panel.draw_task(self.seen.run.task)
        self.seen.event.take(panel.draw_observer_event)
        self.seen.candidates.take(panel.draw_candidates)
        if (status := self.seen.status.value) is not None and self.seen.status.is_new and status.outcome is not None:
            scene.hide_action()
            scene.hide_candidates(0)
        seen = self.seen
        panel.draw_goal(seen.goal.value, seen.verdict.value)
        seen.status.take(lambda status: panel.draw_status(seen.run_state, status, seen.active_step, seen.history))
        served = self._player is not None or seen.run.phase is not RunPhase.ENDED  # the run ends its processes
        seen.end.take(lambda end: panel.draw_end(end, served=served))
        panel.draw_key(scene.shown)
        panel.draw_health(self._health.states)
        panel.draw_log(self._log)
        if panel.controls is not None and self._operator is not None:
            panel.controls.show(self._operator.show())
        panel.show_end(seen.between_tasks)
        if panel.timeline is not None:
            panel.timeline.draw()
        if panel.segmentation is not None:
            panel.segmentation.draw()

    def _picture(self, images: CameraPictures) -> UInt8Array:
        """The picture with the known shapes."""
        state, goal = self.seen.state.value, self.seen.goal.value
        return with_shapes(
            thumbnail(images.reference, PICTURE_WIDTH_PX),
            images.calibration,
            state_world=None if state is None else state.nodes_world,
            goal_world=None if goal is None else goal.nodes_world,
            fixtures=self._around.fixtures,
        )


def _without_absent(layers: tuple[palette.Layer, ...], around: Scene) -> tuple[palette.Layer, ...]:
    return tuple(layer for layer in layers if layer is not palette.FIXTURES or around.fixtures)
