"""A model component on a bus, with the components that communicate with it."""

from collections.abc import Awaitable, Callable

import numpy as np
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.model.component import ModelComponent
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.robot import RobotState

CONFIG = BelievedDlo()
I_SHAPE = builtin_shape("I", CONFIG.length_m, CONFIG.nodes)
S_SHAPE = builtin_shape("S", CONFIG.length_m, CONFIG.nodes)


class Others(Component):
    """All publishers that the model reads, one after another."""

    name = "others"
    reads = (topics.STATE, topics.GOAL, topics.BELIEF)


def with_model(test: Callable[[Port, MemoryTransport], Awaitable[None]]) -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        others = Others()
        host.add(ModelComponent(CONFIG, FRANKA_HAND))
        host.add(others)
        async with host:
            await test(others.port, bus)

    virtual_time.run(main())


def targets(nodes: Float64Array, stamp_ns: int = 1_000) -> TargetPoints:
    return TargetPoints(stamp_ns=stamp_ns, nodes_world=nodes, visible=np.ones(len(nodes), dtype=np.bool_), health=0.9)


def robot_at(position: Float64Array, stamp_ns: int, holding: bool = True) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        stamp_ns=stamp_ns,
        T_world_tcp=geometry.downward(position, np.pi / 2),
        finger_width_m=0.008,
        holding=holding,
    )


async def state_after_a_moment(port: Port) -> DloState | None:
    await port.clock.sleep(0.01)
    return port.latest(topics.STATE).value
