"""Summary statistics of a recording."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dlokit.communication.topics import FLOW, PROTECTION
from dlokit.recording.channels import CALLS_BEGUN, SKILL_CALLS
from dlokit.recording.message_json import from_json
from dlokit.recording.reader import RawRecording, files_of
from dlokit.types.flow import FlowStatus
from dlokit.types.outcome import CallBegun, CallRecord
from dlokit.types.robot import ArmProtection


@dataclass(frozen=True, kw_only=True)
class ChannelSummary:
    """Statistics of one channel."""

    count: int
    schema: str
    """Name of its message type, e.g. ``"dlokit.DloState"``."""
    rate_hz: float | None
    """Mean rate between its first and last message [Hz]; None for fewer than two."""
    size_bytes: int
    """Size before compression."""


@dataclass(frozen=True, kw_only=True)
class CallSummary:
    """Statistics of the calls of one skill."""

    outcomes: Counter[str]
    """Number of calls with each outcome (and its reason, if any)."""
    mean_s: float
    """Mean duration of a call, on the run's clock [s]."""
    longest_s: float
    """Longest duration of a call [s]."""


@dataclass(frozen=True, kw_only=True)
class RecordingSummary:
    """Statistics of one recording."""

    size_bytes: int
    """Total size of its files."""
    files: int
    """Number of its files: a long recording has several."""
    missing: str
    """The parts of its files that could not be read, as text, e.g. after the writer was killed; the rest is valid."""
    duration_s: float
    """Time from the first to the last message, on the run's clock [s]."""
    metadata: Mapping[str, Mapping[str, str]]
    channels: Mapping[str, ChannelSummary]
    calls: Mapping[str, CallSummary]
    """By skill."""
    running: tuple[str, ...]
    """Skills that were running when the recording ended."""
    last_step: FlowStatus | None
    """Last status of the flow; it contains the task's outcome if the run has ended."""
    protections: tuple[ArmProtection, ...] = ()
    """Thresholds and load of real arms, each time they were set."""


class _Calls:
    """Statistics of the calls read so far."""

    def __init__(self) -> None:
        self._running: dict[tuple[str, int], str] = {}
        self._outcomes: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._times_s: defaultdict[str, list[float]] = defaultdict(list)

    def begun(self, call: CallBegun) -> None:
        self._running[call.caller, call.call] = call.skill

    def ended(self, call: CallRecord) -> None:
        self._running.pop((call.caller, call.call), None)
        self._outcomes[call.skill][f"{call.outcome.value} {call.reason}".strip()] += 1
        self._times_s[call.skill].append((call.stamp_ns - call.began_ns) / 1e9)

    def running(self) -> tuple[str, ...]:
        return tuple(self._running.values())

    def summaries(self) -> dict[str, CallSummary]:
        return {
            skill: CallSummary(outcomes=self._outcomes[skill], mean_s=sum(times) / len(times), longest_s=max(times))
            for skill, times in self._times_s.items()
        }


def summarise(path: Path) -> RecordingSummary:
    """Summarise a file. Raises `InputError` if it is not a recording, `SchemaMismatch` if another version wrote it."""
    raw, calls = RawRecording(path=path), _Calls()
    times: defaultdict[str, list[int]] = defaultdict(list)
    sizes: Counter[str] = Counter()
    last_step: bytes | None = None
    protections: list[ArmProtection] = []
    for channel, record in raw:
        times[channel].append(record.log_time)
        sizes[channel] += len(record.data)
        if channel == SKILL_CALLS.name:
            calls.ended(from_json(record.data, CallRecord))
        elif channel == CALLS_BEGUN.name:
            calls.begun(from_json(record.data, CallBegun))
        elif channel == FLOW.name:
            last_step = record.data
        elif channel == PROTECTION.name or channel.startswith(f"{PROTECTION.name}/"):
            protections.append(from_json(record.data, ArmProtection))
    stamps = [stamp for channel in times.values() for stamp in (channel[0], channel[-1])]
    return RecordingSummary(
        size_bytes=sum(file.stat().st_size for file in files_of(path)),
        files=len(files_of(path)),
        missing=raw.missing,
        duration_s=(max(stamps) - min(stamps)) / 1e9 if stamps else 0.0,
        metadata=raw.metadata,
        channels={
            channel: ChannelSummary(
                count=len(of), rate_hz=_rate_hz(of), schema=raw.schemas.get(channel, ""), size_bytes=sizes[channel]
            )
            for channel, of in times.items()
        },
        calls=calls.summaries(),
        running=calls.running(),
        last_step=None if last_step is None else from_json(last_step, FlowStatus),
        protections=tuple(protections),
    )


def _rate_hz(stamps_ns: list[int]) -> float | None:
    span_s = (stamps_ns[-1] - stamps_ns[0]) / 1e9
    return (len(stamps_ns) - 1) / span_s if span_s > 0 else None
