import msgspec
import numpy as np
import pytest
from dlokit_pulled.kalman import KalmanConfig
from dlokit_pulled.observer import PulledConfig

from dlokit.geometry import rmse_m
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategyConfig, prior_from
from dlokit.testing import check_observer, scenes
from dlokit.types.dlo import DloState


def test_it_keeps_to_the_protocol_with_its_memory() -> None:
    report = check_observer(KalmanConfig)
    assert report.memory == ("velocity_m_s", "covariance")
    assert report.gives_covariance


def after(config: ObserverStrategyConfig, clouds: int) -> tuple[DloState, float]:
    """The state after a motion of 5 mm from cloud to cloud, and its error [m]."""
    strategy, prior = config.build(BelievedDlo()), scenes.before(31)
    for seen in scenes.clouds_in_motion(clouds):
        prior = prior_from(strategy.estimate(seen, prior), prior.topology)
    return prior, rmse_m(prior.nodes_world, scenes.rod(31, 0.005 * clouds))


def test_it_finds_the_velocity_and_is_less_noisy_than_what_it_measures() -> None:
    state, off_m = after(KalmanConfig(), 20)
    # 5 mm in 40 ms, less what falls off from cloud to cloud; nodes slide along the rod, so that across it is compared.
    assert np.median(state.memory["velocity_m_s"][:, 0]) == pytest.approx(0.125, rel=0.2)
    assert off_m < after(PulledConfig(), 20)[1]


def test_without_its_memory_it_begins_again() -> None:
    state, _ = after(KalmanConfig(), 5)
    seen = scenes.clouds_in_motion(6)[-1]
    forgotten = msgspec.structs.replace(state, memory={})
    found = KalmanConfig().build(BelievedDlo()).estimate(seen, forgotten)
    assert np.all(found.memory["covariance"][:, 1, 1] > state.memory["covariance"][:, 1, 1])


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="must be above 0"):
        KalmanConfig(noise_m=0.0)
