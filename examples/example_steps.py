"""Common steps of the later examples."""

import asyncio

from example_lab import result_of

from dlokit.communication import topics
from dlokit.description.shapes import builtin_shape
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.system.lockstep import LockstepSystem
from dlokit.types.action import Action, Marks
from dlokit.types.arrays import Int64Array
from dlokit.types.dlo import DloState, GoalShape


async def tracked_state(system: LockstepSystem, goal: GoalShape) -> DloState:
    """Look once and return the model's state, its nodes numbered from the end that is nearer to the goal's node 0."""
    states = system.transport.stream(topics.STATE)
    seen = result_of(await system.transport.call(perception.LOOK))
    result_of(await system.transport.call(observer.INITIALISE, seen.stamp_ns, goal.nodes_world))
    async with asyncio.timeout(5.0):
        return await anext(states)


async def goal_named(system: LockstepSystem, name: str) -> GoalShape:
    """Set one of the built-in shapes as the goal."""
    return result_of(await system.transport.call(model.SET_GOAL, builtin_shape(name, 0.5, 101), name))


async def proposed(system: LockstepSystem, state: DloState, goal: GoalShape, marked: Int64Array) -> Action:
    """Return the planner's best action, without grasps at `marked` nodes."""
    return result_of(await system.transport.call(planning.PROPOSE, state, goal, Marks(invalid_nodes=marked)))
