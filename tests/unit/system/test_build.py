"""What components are built from: their row alone, or more of the run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.mounts import arm_model
from dlokit.description.installation import Installation
from dlokit.description.scene import Post
from dlokit.description.shapes import builtin_shape
from dlokit.geometry import downward
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.rod.rollout import predict
from dlokit.skills.model.api import PREDICT
from dlokit.skills.planning.api import JUDGE_GOAL
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.table import ComponentRow, component_table
from dlokit.types.action import Grasp, Push, VelocityProfile
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.outcome import Outcome, Succeeded


class Plain(Component):
    """A component that needs only its settings."""

    name = "plain"

    def __init__(self, config: BelievedDlo) -> None:
        self.config = config


@dataclass(frozen=True, kw_only=True)
class PlainRow(ComponentRow):
    def load(self) -> type[Component]:
        return Plain


def wiring() -> Wiring:
    return Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=Path(), start_nodes_world=np.zeros((2, 3)))


def test_a_component_without_a_builder_gets_the_settings_of_its_row(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(
        component_table(), "plain", PlainRow(name="plain", kind="nowhere:Plain", settings="model", process="observer")
    )
    config = RunConfig(model=BelievedDlo(nodes=17))
    built = build_component("plain", config, wiring())
    assert isinstance(built, Plain)
    assert built.config is config.model


class Asking(Component):
    """A component that calls others."""

    name = "asking"


def test_planning_judges_goals_by_the_scene_of_the_run() -> None:
    line = builtin_shape("I", 0.5, BelievedDlo().nodes)
    x, y, _ = (float(each) for each in line[15])
    config = RunConfig(installation=Installation(fixtures=(Post(name="peg", position_m=(x, y, 0.0)),)))

    async def judged() -> Outcome[GoalVerdict]:
        host, asking = Container(MemoryTransport(), LoopClock()), Asking()
        host.add(build_component("planning", config, wiring()))
        host.add(asking)
        async with host:
            return await asking.port.call(JUDGE_GOAL, GoalShape(stamp_ns=0, nodes_world=line), 0.012)

    outcome = virtual_time.run(judged())
    assert isinstance(outcome, Succeeded)
    assert "post peg" in outcome.result.text


def test_the_model_predicts_pushes_with_the_fingers_of_the_arm_of_the_run() -> None:
    pytest.importorskip("airo_models", reason="the extra dlokit[arms] is not installed")
    config = RunConfig(arm="ur5e")
    line = builtin_shape("I", config.model.length_m, config.model.nodes)
    x, y, _ = line[15]
    here, there = (downward((x + aside_m, y, 0.01), 0.0) for aside_m in (-0.05, 0.02))
    push = Push(stamp_ns=0, grasp=Grasp(node=15, T_world_tcp=here), path=(there,), velocity=VelocityProfile())
    state = DloState(stamp_ns=0, nodes_world=line, topology=topology(config.model))

    async def predicted() -> Outcome[DloState]:
        host, asking = Container(MemoryTransport(), LoopClock()), Asking()
        host.add(build_component("model", config, wiring()))
        host.add(asking)
        async with host:
            return await asking.port.call(PREDICT, push, state)

    outcome = virtual_time.run(predicted())
    assert isinstance(outcome, Succeeded)
    own, usual = (predict(config.model, line, push, arm_model(arm).gripper) for arm in ("ur5e", "panda"))
    np.testing.assert_array_equal(outcome.result.nodes_world, own)
    assert not np.array_equal(own, usual)
