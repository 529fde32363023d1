"""Experiences out of a run's recording: by the steps of the flow, the states, and where the tool was."""

from collections.abc import Iterable, Iterator

import numpy as np

from dlokit.communication import topics
from dlokit.recording.reader import Recorded
from dlokit.skills.model.identification.experience import Experience
from dlokit.skills.model.identification.grips import Grips
from dlokit.types.dlo import DloState
from dlokit.types.flow import FlowStatus
from dlokit.types.observation import Gripped
from dlokit.types.robot import RobotState

_CHOSEN, _SEEN_AGAIN = "choose_grasp", "has_error_changed"


def experiences(messages: Iterable[Recorded]) -> Iterator[tuple[int, Experience]]:
    """Number of the action, from 1, and what it did; actions in which nothing was held are left out."""
    grips, state, before, action = Grips(), None, None, 0
    for recorded in messages:
        match recorded.message:
            case DloState() as message if recorded.topic == topics.STATE.name:
                state = np.asarray(message.nodes_world)
            case RobotState() as message if recorded.topic == topics.ROBOT_STATE.name:
                grips.moved(message)
            case Gripped() as message:
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
