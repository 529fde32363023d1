"""The model: the simulated DLO whose shape all components use.

Its state follows the observer's target points by PD control; while a gripper holds a node, the state follows the tool
between two looks. A second rod is dragged into goals by the operator's frames.
"""

import math
from collections import deque

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.description.arm.model import Gripper
from dlokit.description.scene import NO_FIXTURES, Scene
from dlokit.description.shapes import builtin_shape
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.rod import rollout
from dlokit.rod.believed import BelievedDlo, as_configured, topology
from dlokit.rod.posterior import Evidence, believed, evidence, posterior
from dlokit.rod.rollout import predict
from dlokit.skills.model import api
from dlokit.skills.model.carry import Carry
from dlokit.skills.model.experiences import GraspLog
from dlokit.skills.model.goal import GoalRod
from dlokit.skills.model.tracking import PdTracker
from dlokit.types.action import Action
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloBelief, DloState, GoalShape, TargetPoints
from dlokit.types.flow import GoalFrame, GoalFrames
from dlokit.types.observation import GraspState
from dlokit.types.passing import SideWish
from dlokit.types.robot import RobotState

_BUILD_ROUNDS = 10  # updates that a far drag takes to settle
_PUBLISH_EVERY_S = 0.1  # between two states while the model follows a tool
# While a gripper holds the rod the model follows the tool. A target this far from it is a mistake of an observer who
# sees the rod half behind the arm; a longer path of the tool allows more [m/m]: the believed friction is not exact.
_HELD_GATE_M = 0.02
_HELD_GATE_PER_M = 0.15


_ACTIONS_KEPT = 200
"""Actions of which the belief is made: the newest, so that hours of tasks neither grow nor slow it."""


class ModelComponent(Component):
    """The model as a component."""

    name = "model"
    publishes = (topics.STATE, topics.GOAL, topics.BELIEF)

    def __init__(
        self,
        config: BelievedDlo,
        gripper: Gripper,
        scene: Scene = NO_FIXTURES,
        beside: tuple[SideWish, ...] = (),
    ) -> None:
        """`gripper` is that of the first arm, whose actions are predicted; `scene` has the believed posts; `beside` is
        for goals without their own."""
        super().__init__()
        self._config, self._gripper, self._beside = config, gripper, beside
        self._posts = scene.posts_world
        self._topology = topology(config)
        self._tracker = PdTracker(config)
        self._goal_rod = GoalRod(config, self._posts)
        self._carry = Carry(config, self._posts)
        self._state: DloState | None = None
        self._goal: GoalShape | None = None
        self._tools: dict[str, RobotState] = {}
        self._grips = GraspLog()
        self._evidence = deque[Evidence](maxlen=_ACTIONS_KEPT)

    async def run(self) -> None:
        """Publish the belief about the DLO."""
        self._publish_belief()

    @on(topics.TARGETS)
    async def on_targets(self, targets: TargetPoints) -> None:
        """PD tracking: drag the model to the target points and publish the state."""
        if targets.nodes_world.shape != (self._config.nodes, 3):
            raise SkillRejected(
                "bad_shape",
                f"there are {len(targets.nodes_world)} target points for the model's {self._config.nodes} nodes; "
                f"give the observer and the model the same number",
            )
        if self._state is None:
            self._tracker.place(targets.nodes_world)
        believed = self._believed(targets) if self._carry.holds else targets.visible
        tracked = self._tracker.track(targets.nodes_world, believed, self._carry.pins(self._tools))
        self._publish(
            DloState(
                stamp_ns=targets.stamp_ns,
                nodes_world=tracked.nodes_world,
                topology=self._topology,
                tracking_error_m=tracked.error_m,
                visible=targets.visible,
                observed_stamp_ns=targets.stamp_ns,
                health=targets.health,
                covariance=targets.covariance,
                memory=targets.memory,
            )
        )

    @on(topics.GRIPPED)
    async def on_gripped(self, gripped: GraspState) -> None:
        """Tie the held node to the tool, or let it go and settle."""
        self._grips.gripped(gripped)
        tool = self._tools.get(gripped.robot)
        if self._state is None or tool is None:
            return
        if gripped.node is None:
            if self._carry.release(gripped.robot):
                self._follow(gripped.stamp_ns)
            return
        self._carry.take_hold(gripped.robot, gripped.node, tool)

    @on(topics.ROBOT_STATE)
    async def on_robot_state(self, robot: RobotState) -> None:
        """Move a held node with the tool, so that the prior of the next look follows the motion."""
        self._tools[robot.robot] = robot
        self._grips.moved(robot)
        if self._carry.move(robot) and self._state is not None:
            since_s = (robot.stamp_ns - self._state.stamp_ns) / 1e9
            if since_s >= _PUBLISH_EVERY_S:
                self._follow(robot.stamp_ns)

    @on(topics.GOAL_FRAMES)
    async def on_goal_frames(self, frames: GoalFrames) -> None:
        """One update of the goal under the operator's frames, at interactive rate."""
        self._drag_goal(frames.frames, rounds=1)

    @implements(api.RESET)
    async def reset(self, nodes_world: Float64Array | None = None) -> None:
        """Put the model at a curve, or at the targets that come next."""
        self._carry.forget()
        self._state = None
        if nodes_world is None:
            return
        _require_curve(nodes_world)
        self._tracker.place(nodes_world)
        self._publish(
            DloState(stamp_ns=self.port.clock.now_ns(), nodes_world=self._tracker.nodes_world, topology=self._topology)
        )

    @implements(api.SET_GOAL)
    async def set_goal(
        self,
        nodes_world: Float64Array,
        name: str = "goal",
        ends_interchangeable: bool = False,
        beside: tuple[SideWish, ...] | None = None,
    ) -> GoalShape:
        """Take a curve as the goal."""
        _require_curve(nodes_world)
        nodes = geometry.resample(nodes_world, self._config.nodes)
        self._goal_rod.place(nodes)
        self._publish_belief()  # a task begins: components that joined after the start receive it now
        return self._publish_goal(nodes, name, ends_interchangeable, beside)

    @implements(api.BUILD_GOAL)
    async def build_goal(self, frames: tuple[GoalFrame, ...]) -> GoalShape:
        """Drag the goal rod by frames until it rests."""
        self._publish_belief()
        return self._drag_goal(frames, rounds=_BUILD_ROUNDS)

    @implements(api.PREDICT)
    async def predict(self, action: Action, state: DloState) -> DloState:
        """The shape that an action would leave."""
        _require_curve(state.nodes_world)
        if not 0 <= action.grasp.node < self._config.nodes or len(state.nodes_world) != self._config.nodes:
            raise SkillRejected(
                "bad_shape",
                f"grasp of node {action.grasp.node} of {len(state.nodes_world)}; the model has {self._config.nodes}",
            )
        nodes = await self.port.compute(predict, self._config, state.nodes_world, action, self._gripper, self._posts)
        return DloState(stamp_ns=state.stamp_ns, nodes_world=nodes, topology=self._topology)

    @implements(api.SETTLE)
    async def settle(self, nodes_world: Float64Array) -> Float64Array:
        """Where a released rod comes to rest under friction."""
        _require_curve(nodes_world)
        return await self.port.compute(rollout.settle, self._config, nodes_world, posts=self._posts)

    @implements(api.LEARN)
    async def learn(self, before_world: Float64Array, after_world: Float64Array) -> DloBelief:
        """Learn from the last grasp-to-release."""
        wanted = (self._config.nodes, 3)
        if before_world.shape != wanted or after_world.shape != wanted:
            raise SkillRejected("bad_shape", f"{before_world.shape} and {after_world.shape}; {wanted} is needed")
        grip = self._grips.take()
        if grip is None:
            raise SkillFailure("nothing_held", "no grip has ended since the last time, or the DLO was lost meanwhile")
        seen = grip.experience(before_world, after_world)
        found = await self.port.compute(evidence, self._config, seen, self._posts)
        if found is None:
            raise SkillFailure("nothing_moved", "the action moved the DLO too little to learn from it")
        self._evidence.append(found)
        return self._publish_belief()

    def _publish_belief(self) -> DloBelief:
        now_ns = self.port.clock.now_ns()
        if self._evidence:
            belief = believed(self._config, posterior(self._config, self._evidence), len(self._evidence), now_ns)
        else:
            belief = as_configured(self._config, now_ns)
        self.port.publish(topics.BELIEF, belief)
        return belief

    def _believed(self, targets: TargetPoints) -> BoolArray:
        """Which targets (M,) may be true of a rod that a tool holds and that the model has followed."""
        moved_m = np.linalg.norm(targets.nodes_world - self._carry.nodes_world, axis=1)
        return targets.visible & (moved_m < _HELD_GATE_M + _HELD_GATE_PER_M * self._carry.travelled_m)

    def _publish(self, state: DloState) -> None:
        self._state = state
        self._carry.place(state.nodes_world)
        self.port.publish(topics.STATE, state)

    def _follow(self, stamp_ns: int) -> None:
        # What was seen, and when, is unchanged: the model predicts only what the tool has done since.
        assert self._state is not None
        nodes = self._carry.nodes_world
        self._tracker.place(nodes)
        self._state = msgspec.structs.replace(self._state, stamp_ns=stamp_ns, nodes_world=nodes)
        self.port.publish(topics.STATE, self._state)

    def _drag_goal(self, frames: tuple[GoalFrame, ...], rounds: int) -> GoalShape:
        for frame in frames:
            values = (frame.x_m, frame.y_m, frame.yaw_rad or 0.0)
            if not 0 <= frame.node < self._config.nodes or not np.isfinite(values).all():
                raise SkillRejected(
                    "bad_frames",
                    f"a frame pulls node {frame.node} to {values}; nodes 0 to {self._config.nodes - 1} and finite "
                    f"numbers are allowed",
                )
        if self._goal is None:
            self._goal_rod.place(self._first_goal(frames))
        for _ in range(rounds):
            self._goal_rod.drag(frames)
        return self._publish_goal(self._goal_rod.nodes_world, "frames", ends_interchangeable=False)

    def _first_goal(self, frames: tuple[GoalFrame, ...]) -> Float64Array:
        if self._state is not None:
            # A camera does not see which end is the first. The order that is nearer to the frames is used: with the
            # other, the frames would turn the rod round and leave it in a loop.
            nodes = self._state.nodes_world
            return min((nodes, nodes[::-1]), key=lambda order: _distance_m(order, frames))
        return builtin_shape("I", self._config.length_m, self._config.nodes, radius_m=self._config.radius_m)

    def _publish_goal(
        self,
        nodes: Float64Array,
        name: str,
        ends_interchangeable: bool,
        beside: tuple[SideWish, ...] | None = None,
    ) -> GoalShape:
        goal = GoalShape(
            stamp_ns=self.port.clock.now_ns(),
            nodes_world=nodes,
            name=name,
            ends_interchangeable=ends_interchangeable,
            beside=self._beside if beside is None else beside,
        )
        self._goal = goal
        self.port.publish(topics.GOAL, goal)
        return goal


def _distance_m(nodes_world: Float64Array, frames: tuple[GoalFrame, ...]) -> float:
    return sum(math.dist(nodes_world[frame.node, :2], (frame.x_m, frame.y_m)) for frame in frames)


def _require_curve(nodes_world: Float64Array) -> None:
    if nodes_world.ndim != 2 or nodes_world.shape[1] != 3 or len(nodes_world) < 2:
        raise SkillRejected("bad_shape", f"a curve is (K, 3) with K of 2 or more; this one is {nodes_world.shape}")
    if not np.isfinite(nodes_world).all():
        raise SkillRejected("bad_shape", "a curve needs finite numbers; this one has NaN or infinity in it")
    if geometry.arc_lengths(nodes_world)[-1] < 1e-3:
        raise SkillRejected("bad_shape", "all points of the curve are at one place; give points along the DLO")
