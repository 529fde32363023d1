"""A component whose code fails in lockstep: the run ends with that error, not with a wait that nobody ends."""

from pathlib import Path

import pytest

from dlokit.communication.component import Component
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import run_lockstep
from dlokit.system.shaping import Watcher

CONFIG = RunConfig(headless=True, seed=3)


def test_a_component_that_breaks_during_a_run_ends_it_with_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(name: str, config: RunConfig, wiring: Wiring) -> Component:
        built = build_component(name, config, wiring)

        async def breaks() -> None:
            await wiring.clock.sleep(0.05)
            raise ZeroDivisionError("a fault in the model's code")

        if name == "model":
            monkeypatch.setattr(built, "run", breaks)
        return built

    with pytest.raises(ZeroDivisionError, match="a fault in the model's code"):
        run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path, Watcher(), build)
