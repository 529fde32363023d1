"""Components that are built from their row alone."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dlokit.communication.component import Component
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.model.component import ModelComponent
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.table import ComponentRow, component_table


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


def test_the_model_needs_no_builder() -> None:
    assert isinstance(build_component("model", RunConfig(), wiring()), ModelComponent)
