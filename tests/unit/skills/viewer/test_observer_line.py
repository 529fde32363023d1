"""The panel's text for the observer's events."""

import pytest

from dlokit.skills.viewer.panel.panel import observer_html
from dlokit.types.observation import DistrustReason, ObserverEvent, ObserverEventKind

LOST, FOUND_AGAIN, REFUSED = ObserverEventKind
HAS_NO_POINTS = "The observer keeps its estimate: the clouds have no points of the DLO (health 0.70)"


@pytest.mark.parametrize(
    ("kind", "reason", "said"),
    [
        (LOST, DistrustReason.LOW_HEALTH, "The observer is unsure of its estimate (health 0.70)"),
        (LOST, DistrustReason.NO_POINTS, HAS_NO_POINTS),
        (FOUND_AGAIN, None, "The observer has found the DLO again (health 0.70)"),
        (REFUSED, DistrustReason.OLD_STAMP, "The observer keeps its estimate: the clouds are not newer (health 0.70)"),
    ],
)
def test_the_line_says_what_the_observer_does_now_and_why(
    kind: ObserverEventKind, reason: DistrustReason | None, said: str
) -> None:
    assert said in observer_html(ObserverEvent(stamp_ns=1, kind=kind, reason=reason, health=0.7))


def test_every_reason_has_a_sentence_of_its_own() -> None:
    lines = {
        observer_html(ObserverEvent(stamp_ns=1, kind=LOST, reason=reason, health=0.7)) for reason in DistrustReason
    }
    assert len(lines) == len(DistrustReason)
