"""From when messages were sent to how long each hop took."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

EXPOSURE, PICTURES, CLOUD, TARGETS, STATE, DECISION = (
    "exposure",
    "pictures",
    "cloud",
    "targets",
    "state",
    "decision",
)
STATIONS = (EXPOSURE, PICTURES, CLOUD, TARGETS, STATE, DECISION)
WHOLE_WAY = (EXPOSURE, DECISION)


@dataclass
class Sent:
    """When messages of a run were sent, on the machine's monotonic clock [s]."""

    ticks: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])
    """Stamps of the cell's clock [ns], in order, and when they were sent."""
    by_exposure: dict[str, dict[int, float]] = field(default_factory=dict[str, dict[int, float]])
    """By station, but for the exposure itself and the decision: the first message that speaks of an exposure [ns]."""
    decisions_s: list[float] = field(default_factory=list[float])
    """When the decision layer told of a step."""

    def note(self, station: str, exposure_ns: int, sent_s: float) -> None:
        """A message that speaks of an exposure; the first one counts."""
        self.by_exposure.setdefault(station, {}).setdefault(exposure_ns, sent_s)


def hops(sent: Sent) -> dict[tuple[str, str], list[float]]:
    """Seconds of each hop, by the stations that it joins, and of the whole way; one a look that came so far."""
    looks = looks_of(sent)
    found: dict[tuple[str, str], list[float]] = {}
    for pair in (*itertools.pairwise(STATIONS), WHOLE_WAY):
        found[pair] = [look[pair[1]] - look[pair[0]] for look in looks if pair[0] in look and pair[1] in look]
    return found


def looks_of(sent: Sent) -> list[dict[str, float]]:
    """For each exposure, in order, when it had come to each station."""
    exposures = sorted({exposure for by_exposure in sent.by_exposure.values() for exposure in by_exposure})
    looks: list[dict[str, float]] = []
    for exposure_ns in exposures:
        look = {station: times[exposure_ns] for station, times in sent.by_exposure.items() if exposure_ns in times}
        exposed_s = machine_time_s(exposure_ns, sent.ticks)
        if exposed_s is not None:
            look[EXPOSURE] = exposed_s
        looks.append(look)
    _decide(looks, sorted(sent.decisions_s))
    return looks


def machine_time_s(stamp_ns: int, ticks: Sequence[tuple[int, float]]) -> float | None:
    """When the cell's clock showed a stamp, on the machine's [s]; None outside of the ticks that were heard."""
    if not ticks or not ticks[0][0] <= stamp_ns <= ticks[-1][0]:
        return None
    stamps, sent_s = zip(*ticks, strict=True)
    return float(np.interp(stamp_ns, stamps, sent_s))


def _decide(looks: Sequence[dict[str, float]], decisions_s: Sequence[float]) -> None:
    """A look is decided upon by the first step that is told after its state, and before the next one's."""
    decided = [look for look in looks if STATE in look]
    until = [later[STATE] for later in decided[1:]] + [np.inf] * bool(decided)
    for look, until_s in zip(decided, until, strict=True):
        after = [time_s for time_s in decisions_s if look[STATE] < time_s <= until_s]
        if after:
            look[DECISION] = after[0]


def named(pair: tuple[str, str]) -> str:
    """A hop in words."""
    return f"{pair[0]} → {pair[1]}"


Hops = Mapping[tuple[str, str], Sequence[float]]
