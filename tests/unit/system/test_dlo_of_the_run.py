"""Configured knowledge about another DLO: measurements with a ruler, and the run's own settings."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.dlo import SILICONE_HOSE, SOFT_ROPE, WIRE_B
from dlokit.errors import ConfigError
from dlokit.rod.believed import BeliefConfig, BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.config import OURS
from dlokit.skills.observer.cpd import Cpd
from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import UNKNOWN_STIFFNESS_LOG_SD, RunConfig, with_dlo
from dlokit.system.configuration.toml_config import from_plain, to_plain


def test_the_default_rope_has_the_default_belief() -> None:
    run = RunConfig()
    assert with_dlo(run, run.cell.dlo) == run


def test_of_another_dlo_only_length_and_radius_are_known() -> None:
    model = with_dlo(RunConfig(), SILICONE_HOSE).model
    assert (model.length_m, model.radius_m) == (SILICONE_HOSE.length_m, SILICONE_HOSE.radius_m)
    assert model.bending_stiffness_n_m2 == BelievedDlo().bending_stiffness_n_m2 != SILICONE_HOSE.bending_stiffness_n_m2
    assert model.belief.stiffness_log_sd == UNKNOWN_STIFFNESS_LOG_SD


def test_a_configured_stiffness_is_believed_with_its_uncertainty() -> None:
    told = BelievedDlo(bending_stiffness_n_m2=4e-4, belief=BeliefConfig(stiffness_log_sd=0.9))
    model = with_dlo(replace(RunConfig(), model=told), WIRE_B).model
    assert (model.bending_stiffness_n_m2, model.belief.stiffness_log_sd) == (4e-4, 0.9)


def test_the_uncertainty_of_the_default_stiffness_can_be_configured() -> None:
    told = BelievedDlo(belief=BeliefConfig(stiffness_log_sd=0.5))
    assert with_dlo(replace(RunConfig(), model=told), WIRE_B).model.belief.stiffness_log_sd == 0.5


def leaves(plain: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(plain, dict):
        yield path, plain
        return
    for key, value in plain.items():
        yield from leaves(value, f"{path}.{key}" if path else key)


@pytest.mark.parametrize("observer", OURS, ids=[config.name for config in OURS])
def test_the_radius_of_a_dlo_is_configured_in_one_place_besides_the_cell(observer: type[Any]) -> None:
    run = replace(RunConfig(), observer=replace(RunConfig().observer, strategy=observer()))
    homes = {path for path, value in leaves(to_plain(run)) if "radius" in path and value == SOFT_ROPE.radius_m}
    assert homes == {"cell.dlo.radius_m", "model.radius_m"}


TOLD: list[BelievedDlo] = []


@dataclass(frozen=True, kw_only=True)
class AskingObserver:
    name: ClassVar[str] = "asking"

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        TOLD.append(dlo)
        return Cpd()


@dataclass(frozen=True, kw_only=True)
class AskingPlanner:
    name: ClassVar[str] = "asking"

    def build(self, tools: PlanningTools) -> ActionStrategy:
        TOLD.append(tools.model)
        return FarthestConfig().build(tools)


@pytest.mark.parametrize("component", ["observer", "planning"])
def test_strategies_are_built_for_the_configured_dlo(component: str) -> None:
    run, TOLD[:] = with_dlo(RunConfig(), WIRE_B), []
    run = replace(
        run,
        observer=replace(run.observer, strategy=AskingObserver()),
        planning=replace(run.planning, strategy=AskingPlanner()),
    )
    wiring = Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=Path(), start_nodes_world=np.zeros((2, 3)))
    build_component(component, run, wiring)
    assert [(dlo.length_m, dlo.radius_m) for dlo in TOLD] == [(WIRE_B.length_m, WIRE_B.radius_m)]


@pytest.mark.parametrize(
    ("table", "key"),
    [
        (("perception", "cloud"), "dlo_radius_m"),
        (("planning", "actions", "grasp"), "rod_radius_m"),
        (("observer", "strategy"), "radius_m"),
    ],
)
def test_a_radius_for_one_component_alone_is_refused_by_name(table: tuple[str, ...], key: str) -> None:
    plain = to_plain(RunConfig())
    at = plain
    for name in table:
        at = at[name]
    at[key] = 0.004
    with pytest.raises(ConfigError, match=f"{': '.join(table)}: unknown key {key}"):
        from_plain(plain, RunConfig, "config.toml")
