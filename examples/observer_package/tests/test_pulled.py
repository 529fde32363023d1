import numpy as np
import pytest
from dlokit_pulled.observer import PulledConfig

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.config import strategies
from dlokit.testing import check_observer, scenes


def test_it_keeps_to_the_protocol() -> None:
    assert check_observer(PulledConfig).follows_branches


def test_it_is_found_by_its_entry_point() -> None:
    assert strategies()["pulled"] is PulledConfig


def test_the_rod_keeps_its_length() -> None:
    prior = scenes.before(31)
    nodes = PulledConfig().build(BelievedDlo()).estimate(scenes.cloud(0.02), prior).nodes_world
    length_m = np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()
    # Ten rounds a step leave a remainder; 2 % is 1 cm of half a metre.
    assert length_m == pytest.approx(prior.topology.rest_lengths_m.sum(), rel=0.02)


def test_scales_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="last_scale_m <= first_scale_m"):
        PulledConfig(last_scale_m=0.1)
