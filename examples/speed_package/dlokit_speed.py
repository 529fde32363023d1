"""A component that publishes how fast the middle node of the DLO moves."""

import numpy as np

from dlokit.communication import topics
from dlokit.communication.component import Component, on
from dlokit.communication.topic import Topic
from dlokit.system.config import RunConfig
from dlokit.system.table import AGAIN, ComponentRow, ProcessRow
from dlokit.types.dlo import DloState
from dlokit.types.message import Message


class NodeSpeed(Message, frozen=True, kw_only=True, eq=False):
    """How fast a node moves between two states of the model."""

    node: int
    speed_m_s: float


SPEED = Topic("speed/node", NodeSpeed, "speed", None, doc="how fast the middle node moves")
PROCESS = ProcessRow(name="speed", components=("speed",), restart=AGAIN, essential=False)
ROW = ComponentRow(name="speed", kind="dlokit_speed:SpeedComponent", process=PROCESS)


class SpeedComponent(Component):
    name = "speed"
    publishes = (SPEED,)

    def __init__(self, config: RunConfig) -> None:
        self._node, self._last = config.model.nodes // 2, None

    @on(topics.STATE)
    async def moved(self, state: DloState) -> None:
        last, self._last = self._last, state
        if last is not None and state.stamp_ns > last.stamp_ns:
            moved_m = np.linalg.norm(state.nodes_world[self._node] - last.nodes_world[self._node])
            speed_m_s = float(moved_m) * 1e9 / (state.stamp_ns - last.stamp_ns)
            self.port.publish(SPEED, NodeSpeed(stamp_ns=state.stamp_ns, node=self._node, speed_m_s=speed_m_s))
