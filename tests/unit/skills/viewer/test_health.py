from dlokit.communication.transport import Liveness
from dlokit.skills.viewer.panel.health import EventLog, Health, WatchedComponent, health_html

CAMERA = WatchedComponent(name="perception", process="camera")
MODEL = WatchedComponent(name="model", process="simulation")


def _look(health: Health, **servers: str) -> list[str]:
    """One look; a component without a server does not answer."""
    return health.look(lambda name: Liveness(alive=name in servers, server=servers.get(name, "")))


def test_a_component_that_has_not_started_is_not_lost() -> None:
    health = Health([CAMERA, MODEL])
    assert _look(health, model="1") == []
    assert health.lost == ()
    assert [state.component.name for state in health.states] == ["model"]


def test_a_killed_component_is_lost_until_another_process_answers_for_it() -> None:
    health = Health([CAMERA, MODEL])
    _look(health, perception="1", model="1")
    assert _look(health, model="1") == ["perception (process camera) does not answer"]
    assert health.lost == ("perception",)
    assert _look(health, perception="2", model="1") == ["perception (process camera) answers again"]
    assert health.lost == ()
    assert [state.restarts for state in health.states] == [1, 0]


def test_a_restart_between_two_looks_is_counted() -> None:
    health = Health([MODEL])
    _look(health, model="1")
    _look(health, model="2")
    assert health.states[0].restarts == 1


def test_the_health_of_each_component_is_shown() -> None:
    health = Health([CAMERA])
    _look(health, perception="1")
    _look(health)
    html = health_html(health.states)
    assert 'data-component="perception" data-alive="false"' in html
    assert "does not answer" in html


def test_the_log_has_the_newest_event_first_without_repetitions_or_markup() -> None:
    log = EventLog(lambda stamp_ns: f"{stamp_ns} ns")
    for text in ("look", "look", "", "<b>compare</b>"):
        log.add(text, 7)
    html = log.html()
    assert html.count("look") == 1
    assert html.index("compare") < html.index("look")
    assert "<b>" not in html
    assert html.count("7 ns") == 2


def test_the_log_is_bounded() -> None:
    log = EventLog(lambda stamp_ns: f"{stamp_ns} ns")
    for number in range(2 * EventLog.LINES):
        log.add(f"event {number}.", number)
    assert "event 0." not in log.html()
    assert f"event {2 * EventLog.LINES - 1}." in log.html()
