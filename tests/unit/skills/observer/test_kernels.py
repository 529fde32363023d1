"""Compilation before the first frame covers everything that the frame needs."""

from typing import Any
from unittest.mock import MagicMock

import pytest
from synthetic_clouds import cloud, shape, state

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer import compiled
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.observer.map import terms, view


def versions() -> dict[str, int]:
    """Number of compiled versions of each kernel, one for each combination of argument types."""
    return {name: len(kernel.signatures) for name, kernel in vars(compiled).items() if hasattr(kernel, "signatures")}


@pytest.mark.parametrize("config", OURS, ids=[config.name for config in OURS])
def test_after_loading_no_observer_compiles_anything(config: type[ObserverStrategyConfig]) -> None:
    load_kernels()
    before = versions()
    assert before["expectation"] == 1
    config().build(BelievedDlo()).estimate(cloud(shape("S")), state(shape("S")))
    assert versions() == before


@pytest.mark.parametrize(
    "kernel",
    [
        vars(view)["_shaded"],
        vars(view)["_nearest_shade"],
        view.behind_in_camera,
        vars(terms)["add_tip"],
        vars(terms)["add_place"],
    ],
    ids=lambda kernel: kernel.__name__,
)
def test_loading_also_compiles_for_hidden_parts_tips_and_pins(kernel: Any) -> None:
    load_kernels()
    assert kernel.signatures


def test_ctrl_c_while_code_is_loaded_ends_the_program() -> None:
    interrupted: Any = MagicMock()  # by Numba, whose code is interrupted
    interrupted.build.side_effect = SystemError("returned a result with an exception set")
    interrupted.build.side_effect.__cause__ = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        load_kernels([interrupted])
