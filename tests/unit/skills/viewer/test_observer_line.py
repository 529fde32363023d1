"""The panel's text for the observer's events."""

import pytest

from dlokit.skills.viewer.panel.panel import observer_html
from dlokit.types.observation import DistrustReason, ObserverEvent, ObserverEventKind


@pytest.mark.parametrize(
    ("kind", "reason", "said"),
    [
        (ObserverEventKind.LOST, DistrustReason.LOW_HEALTH, "Observer, in doubt: low health (health 0.70)"),
        (ObserverEventKind.LOST, DistrustReason.ELSEWHERE, "Observer, lost: elsewhere (health 0.70)"),
        (ObserverEventKind.FOUND_AGAIN, None, "Observer, found again (health 0.70)"),
        (ObserverEventKind.REFUSED, DistrustReason.OLD_STAMP, "Observer, refused: old stamp (health 0.70)"),
    ],
)
def test_only_a_rod_away_from_its_tracked_position_is_reported_as_lost(
    kind: ObserverEventKind, reason: DistrustReason | None, said: str
) -> None:
    assert said in observer_html(ObserverEvent(stamp_ns=1, kind=kind, reason=reason, health=0.7))
