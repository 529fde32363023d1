"""What is in a recording, in figures."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dlokit.communication.recording.channels import SKILL_CALLS
from dlokit.communication.recording.plain import from_json
from dlokit.communication.recording.reader import RawRecording
from dlokit.communication.topics import FLOW
from dlokit.types.flow import FlowStatus
from dlokit.types.skill_call import CallRecord


@dataclass(frozen=True, kw_only=True)
class ChannelSummary:
    """One channel."""

    count: int
    schema: str
    """Name of its type, e.g. ``"dlokit.DloState"``."""
    rate_hz: float | None
    """Mean rate between its first and its last message; None for fewer than two."""


@dataclass(frozen=True, kw_only=True)
class RecordingSummary:
    """One file."""

    size_bytes: int
    whole: bool
    """False: the writer was killed before it ended the file; what is there is good."""
    duration_s: float
    """From the first message to the last, on the run's clock."""
    metadata: Mapping[str, Mapping[str, str]]
    channels: Mapping[str, ChannelSummary]
    calls: Mapping[str, Counter[str]]
    """By skill, how often each outcome."""
    last_step: FlowStatus | None
    """Where the flow was; its outcome when the run had ended."""


def summarise(path: Path) -> RecordingSummary:
    """Read a file through. Raises `InputError` when it is no recording, `SchemaMismatch` when another version's."""
    raw = RawRecording(path=path)
    times: defaultdict[str, list[int]] = defaultdict(list)
    calls: defaultdict[str, Counter[str]] = defaultdict(Counter)
    last_step: bytes | None = None
    for channel, record in raw:
        times[channel].append(record.log_time)
        if channel == SKILL_CALLS.name:
            call = from_json(record.data, CallRecord)
            calls[call.skill][f"{call.outcome.value} {call.reason}".strip()] += 1
        elif channel == FLOW.name:
            last_step = record.data
    stamps = [stamp for channel in times.values() for stamp in (channel[0], channel[-1])]
    return RecordingSummary(
        size_bytes=path.stat().st_size,
        whole=raw.whole,
        duration_s=(max(stamps) - min(stamps)) / 1e9 if stamps else 0.0,
        metadata=raw.metadata,
        channels={
            channel: ChannelSummary(count=len(of), rate_hz=_rate_hz(of), schema=raw.schema_of(channel))
            for channel, of in times.items()
        },
        calls=calls,
        last_step=None if last_step is None else from_json(last_step, FlowStatus),
    )


def _rate_hz(stamps_ns: list[int]) -> float | None:
    span_s = (stamps_ns[-1] - stamps_ns[0]) / 1e9
    return (len(stamps_ns) - 1) / span_s if span_s > 0 else None
