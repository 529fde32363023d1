"""Who held which node and where the tool went, action by action: as it happens, or out of a run's recording."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from dlokit.communication import topics
from dlokit.recording.reader import Recorded
from dlokit.rod.posterior import Experience, tool_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.flow import FlowStatus
from dlokit.types.observation import GraspState
from dlokit.types.robot import RobotState

_LOST_SHARE = 0.7  # of the width before: fingers that hold nothing any more and are nearer than this have closed


@dataclass(frozen=True, kw_only=True)
class FinishedGrasp:
    """A node that one robot alone held from a grasp to a release."""

    node: int
    states: tuple[RobotState, ...]

    def experience(self, before_world: Float64Array, after_world: Float64Array) -> Experience:
        """What came of it: the shapes (M, 3) [m] before the grasp and after the release."""
        times_s, tool = tool_of(self.states)
        return Experience(
            before_world=before_world, after_world=after_world, node=self.node, times_s=times_s, tool=tool
        )


_LONGEST_GRASP = 30_000
"""States of the arm during a grasp, ten minutes: of a longer one nothing is learnt."""


class GraspLog:
    """Follows messages; keeps the last grip that has ended."""

    def __init__(self) -> None:
        self._open: GraspState | None = None
        self._states: list[RobotState] = []
        self._opening = False
        self._ended: FinishedGrasp | None = None

    def gripped(self, message: GraspState) -> None:
        """A node is held, or let go."""
        held, self._open = self._open, None
        self._ended = None
        if held is None and message.node is not None:
            self._open, self._states, self._opening = message, [], False
        elif held is not None and held.node is not None and message.node is None and message.robot == held.robot:
            # Two robots at once are another matter: of those nothing is learnt.
            self._ended = FinishedGrasp(node=held.node, states=tuple(self._states))

    def moved(self, state: RobotState) -> None:
        """A tool is somewhere. Fingers that open let go; fingers that close have lost what they held."""
        if self._open is None or state.robot != self._open.robot or self._opening:
            return
        last = self._states[-1] if self._states else None
        if last is not None and last.holding and not state.holding:
            self._opening = True
            if state.finger_width_m < _LOST_SHARE * last.finger_width_m:
                self._open = None
        elif len(self._states) == _LONGEST_GRASP:
            self._open = None
        elif last is None or state.stamp_ns > last.stamp_ns:
            self._states.append(state)

    def take(self) -> FinishedGrasp | None:
        """The last grip that has ended, once; None when there is none of any length."""
        ended, self._ended = self._ended, None
        return ended if ended is not None and len(ended.states) > 1 else None


_CHOSEN, _SEEN_AGAIN = "choose_grasp", "has_error_changed"


def experiences(messages: Iterable[Recorded]) -> Iterator[tuple[int, Experience]]:
    """Number of the action, from 1, and what it did; actions in which nothing was held are omitted."""
    grips, state, before, action = GraspLog(), None, None, 0
    for recorded in messages:
        match recorded.message:
            case DloState() as message if recorded.topic == topics.STATE.name:
                state = np.asarray(message.nodes_world)
            case RobotState() as message if recorded.topic == topics.ROBOT_STATE.name:
                grips.moved(message)
            case GraspState() as message:
                grips.gripped(message)
            case FlowStatus(step=step) if step == _CHOSEN:
                before = state
                grips.take()
            case FlowStatus(step=step) if step == _SEEN_AGAIN:
                action += 1
                grip = grips.take()
                if grip is not None and before is not None and state is not None:
                    yield action, grip.experience(before, state)
            case _:
                pass
