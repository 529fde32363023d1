"""The summary: the default observer compared with the best peer of each case, and with the bounds."""

import numpy as np
import pytest

from dlokit.extras.bench.observers import iterations
from dlokit.extras.bench.observers.cases import CASES, ObserverCase
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.figures import ALL_CASES, Bar, bars, compare
from dlokit.extras.bench.observers.iterations import IterationTimes
from dlokit.extras.bench.observers.methods import PUBLISHED, default_name
from dlokit.extras.bench.observers.metrics import METRICS
from dlokit.extras.bench.observers.runner import Trial

CASE = ObserverCase(name="base")


def _trials(errors_m: dict[str, list[float]]) -> list[Trial]:
    return [
        Trial(case="base", seed=seed, method=method, frames=9, figures={"node error": error})
        for method, values in errors_m.items()
        for seed, error in enumerate(values)
    ]


def test_the_default_observer_is_compared_with_the_best_peer_without_pins() -> None:
    errors = {
        default_name(): [0.004, 0.006],
        f"{default_name()}, pinned": [0.001, 0.001],
        "pycpd": [0.02, 0.02],
        "cpd": [0.01, 0.01],
        "cpd, pinned": [0.001, 0.001],
        "of a third party": [0.001, 0.001],
    }
    (one,) = compare(_trials(errors), [CASE])
    assert (one.peer, one.own_m, one.peer_m) == ("cpd", pytest.approx(0.005), pytest.approx(0.01))
    assert one.figure.value == pytest.approx(0.5)
    assert (one.figure.low, one.figure.high) == (pytest.approx(0.4), pytest.approx(0.6))
    assert one.met


def test_only_seeds_that_all_methods_have_run_are_compared() -> None:
    errors = {default_name(): [0.004, 0.9], "pycpd": [0.02, 0.1], "cpd": [0.01]}
    (one,) = compare(_trials(errors), [CASE])
    assert one.figure.value == pytest.approx(0.4)


def test_without_a_peer_there_is_nothing_to_compare() -> None:
    assert list(compare(_trials({default_name(): [0.004]}), [CASE])) == []
    assert list(compare(_trials({"cpd": [0.004]}), [CASE])) == []


def test_an_extra_case_has_no_bound() -> None:
    (one,) = compare(_trials({default_name(): [0.1], "cpd": [0.1]}), [ObserverCase(name="base", extra=True)])
    assert not one.met
    assert not one.has_bar


def test_peers_are_the_packages_and_our_implementations_of_papers() -> None:
    assert set(PUBLISHED) == {"pycpd", "probreg", "cpd", "spr", "som"}


def test_no_frame_may_be_lost_in_cases_with_few_hidden_nodes_except_in_the_dark() -> None:
    never_lost = {bar.case for bar in bars(CASES) if bar.metric == "frames over 50 mm"}
    assert {"base", "hidden 0 %", "swing 1 m/s", "crossing"} <= never_lost
    assert {"hidden 50 %", "hidden 70 %", "dark for 1 s", "camera error"}.isdisjoint(never_lost)
    assert bars([ObserverCase(name="x", conditions=Conditions(hidden=0.7))]) == bars([])


def test_a_bound_is_met_from_below_or_from_above() -> None:
    assert Bar(case="base", metric="node error", most=0.008).met(0.008)
    assert not Bar(case="base", metric="node error", most=0.008).met(0.0081)
    assert Bar(case="base", metric="m", most=0.6, is_least=True).met(0.6)
    assert not Bar(case="base", metric="m", most=0.6, is_least=True).met(0.59)


def test_every_bound_has_an_existing_case_and_metric() -> None:
    once = np.array([1.0])
    times = [IterationTimes(method=m, points=2000, iterations_s=once, setups_s=once) for m in ("cpd", "pycpd")]
    known = {(row.case, row.metric) for row in iterations.figures(times)}
    known |= {(case, metric.name) for case in (*(case.name for case in CASES), ALL_CASES) for metric in METRICS}
    assert {(bar.case, bar.metric) for bar in bars(CASES)} <= known
