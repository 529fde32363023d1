"""The skills of a live system as methods, with the arguments and results of their declarations."""

from collections.abc import Callable
from typing import Any, Generic, ParamSpec, Protocol, Self, TypeVar, overload

from dlokit.communication.skill import Skill
from dlokit.decision import api as decision
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.observation import Observation

P = ParamSpec("P")
R = TypeVar("R")


class BlockingCall(Protocol):
    """Calls a skill of a running system and waits for its result."""

    def __call__(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """The result. Raises `SkillFailure` and `SkillRejected`."""
        ...


class SkillMethod(Generic[P, R]):
    """A skill as a method: `system.perception.look()`."""

    def __init__(self, skill: Skill[P, R]) -> None:
        """`skill` is the declaration; it also provides the documentation."""
        self.skill = skill

    @overload
    def __get__(self, owner: None, kind: type[Any]) -> Self: ...

    @overload
    def __get__(self, owner: "Skills", kind: type[Any]) -> Callable[P, R]: ...

    def __get__(self, owner: "Skills | None", kind: type[Any]) -> "Self | Callable[P, R]":
        if owner is None:
            return self
        skill = self.skill.at(owner.instance)

        def method(*args: P.args, **kwargs: P.kwargs) -> R:
            return owner.call(skill, *args, **kwargs)

        method.__name__ = skill.name
        method.__doc__ = skill.doc
        return method


class Skills:
    """The skills of one component."""

    def __init__(self, call: BlockingCall, instance: str = "") -> None:
        """`instance` selects one of several instances, e.g. ``second`` for the second robot."""
        self.call, self.instance = call, instance

    def at(self, instance: str) -> Self:
        """The skills of another instance: ``system.robot.at("second")``."""
        return type(self)(self.call, instance)


class PerceptionSkills(Skills):
    """Looking."""

    def __init__(self, call: BlockingCall, observed: Callable[[int], Observation]) -> None:
        """`observed` returns the published observation with a stamp [ns], or a newer one."""
        super().__init__(call)
        self._observed = observed

    def look(self) -> Observation:
        """Look once; returns the DLO's points. Raises as the skill `perception.look`."""
        return self._observed(self.call(perception.LOOK).stamp_ns)

    set_box = SkillMethod(perception.SET_BOX)
    set_segmentation = SkillMethod(perception.SET_SEGMENTATION)
    set_tracking = SkillMethod(perception.SET_TRACKING)
    note_background = SkillMethod(perception.NOTE_BACKGROUND)
    see_hand = SkillMethod(perception.SEE_HAND)
    check_camera = SkillMethod(perception.CHECK_CAMERA)
    check_fixtures = SkillMethod(perception.CHECK_FIXTURES)


class ObserverSkills(Skills):
    """Estimating the nodes."""

    initialise = SkillMethod(observer.INITIALISE)
    set_strategy = SkillMethod(observer.SET_STRATEGY)
    reset = SkillMethod(observer.RESET)


class ModelSkills(Skills):
    """The model of the DLO, and the goal."""

    reset = SkillMethod(model.RESET)
    set_goal = SkillMethod(model.SET_GOAL)
    build_goal = SkillMethod(model.BUILD_GOAL)
    predict = SkillMethod(model.PREDICT)
    settle = SkillMethod(model.SETTLE)
    learn = SkillMethod(model.LEARN)


class PlanningSkills(Skills):
    """Judging goals, and choosing actions."""

    propose = SkillMethod(planning.PROPOSE)
    judge_goal = SkillMethod(planning.JUDGE_GOAL)
    check_start = SkillMethod(planning.CHECK_START)
    foresee_control = SkillMethod(planning.FORESEE_CONTROL)
    correct = SkillMethod(planning.CORRECT)
    set_strategy = SkillMethod(planning.SET_STRATEGY)


class RobotSkills(Skills):
    """Moving and stopping an arm."""

    move_joints = SkillMethod(robot.MOVE_JOINTS)
    move_to = SkillMethod(robot.MOVE_TO)
    move_linear = SkillMethod(robot.MOVE_LINEAR)
    follow_path = SkillMethod(robot.FOLLOW_PATH)
    grasp = SkillMethod(robot.GRASP)
    release = SkillMethod(robot.RELEASE)
    home = SkillMethod(robot.HOME)
    halt = SkillMethod(robot.HALT)
    stop = SkillMethod(robot.STOP)
    enable = SkillMethod(robot.ENABLE)
    recover = SkillMethod(robot.RECOVER)


class DecisionSkills(Skills):
    """Whole tasks."""

    shape_dlo = SkillMethod(decision.SHAPE_DLO)
    see_goal = SkillMethod(decision.SEE_GOAL)
    stop_task = SkillMethod(decision.STOP_TASK)
