"""What the observer tells beside its targets: that it lost the DLO, found it again, or could not use a cloud."""

import enum

from dlokit.types.message import Message


class ObserverEventKind(enum.Enum):
    """What happened."""

    LOST = "lost"
    FOUND_AGAIN = "found_again"
    REFUSED = "refused"
    """Clouds are not used; told at the first of them."""


class Doubt(enum.Enum):
    """Why targets are not what the cloud shows, or not to be trusted."""

    NO_POINTS = "no_points"
    """Too few points that are numbers."""
    FAR_POINTS = "far_points"
    """Most points lie farther off than the DLO can have gone: another frame, or another unit."""
    OLD_STAMP = "old_stamp"
    """The cloud is not newer than the state."""
    NOT_THE_DLO = "not_the_dlo"
    """Hardly any point lies on the DLO, and it is nowhere else in the cloud: the table, or something else."""
    BAD_TARGETS = "bad_targets"
    """The strategy failed, or its targets are no numbers or not as many as there are nodes."""
    LOW_HEALTH = "low_health"
    """The strategy itself says so."""
    ELSEWHERE = "elsewhere"
    """The cloud, ordered anew, shows the DLO where the strategy did not find it."""


class ObserverEvent(Message, frozen=True, kw_only=True, eq=False):
    """One event, with the stamp of the cloud at which it happened."""

    kind: ObserverEventKind
    reason: Doubt | None
    """None when found again."""
    health: float
