"""Rehearses a motion in software: the robot component plans and checks it for a copy of the arm at its present pose."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.mounts import ArmMount
from dlokit.functional.robots.base import Robot
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import RunConfig
from dlokit.system.table import components_of_run
from dlokit.types.outcome import Outcome
from dlokit.types.robot import RobotState


@dataclass(frozen=True, kw_only=True)
class Rehearsal:
    """The predicted result of a motion."""

    outcome: Outcome[Any]
    duration_s: float
    """Its duration on the arm's clock [s]."""
    ends: RobotState
    """The state of its arm afterwards."""


def rehearsed(
    config: RunConfig, states: Mapping[str, RobotState], skill: Skill[..., Any], arguments: Mapping[str, Any]
) -> Rehearsal:
    """Call a robot's skill for arms in software that start in `states`, by the name of each arm; time is simulated.

    They are the arms of `config`, with its limits, workspaces and speed scale; no real arm moves.
    """
    arms = replace(config, runtime="lockstep", dry_run=False, driver=_StandingArms(states=states), hosts=None)
    return virtual_time.run(_rehearse(arms, skill, arguments))


async def _rehearse(config: RunConfig, skill: Skill[..., Any], arguments: Mapping[str, Any]) -> Rehearsal:
    kind, _, instance = skill.component.partition(".")
    names = [name for name in components_of_run(config) if name.partition(".")[0] == kind]
    async with assemble(names, config, Wiring()) as host:
        transport, clock = host.transport, host.clock
        states = transport.stream(topics.ROBOT_STATE.at(instance))
        await anext(states)
        began_ns = clock.now_ns()
        outcome = await transport.call(skill, **arguments)
        duration_s = (clock.now_ns() - began_ns) / 1e9
        async for state in states:
            if state.stamp_ns >= began_ns + round(duration_s * 1e9):
                return Rehearsal(outcome=outcome, duration_s=duration_s, ends=state)
    raise AssertionError("the arm in software publishes its state until the end")


@dataclass(frozen=True, kw_only=True)
class _StandingArms:
    """The driver of arms in software that start in given states."""

    name: ClassVar[str] = "standing"
    in_cell: ClassVar[bool] = False
    is_real: ClassVar[bool] = False
    states: Mapping[str, RobotState]

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver."""
        from dlokit.functional.robots.kinematic import KinematicRobot

        return KinematicRobot(port.clock, mount, standing=self.states[mount.robot])
