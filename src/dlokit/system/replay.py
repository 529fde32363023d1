"""Replays a recorded run into one component and compares the outputs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import InputError
from dlokit.functional.cameras.recorded import PlayedCamera, RecordedLook
from dlokit.recording.comparison import FieldRow, compare
from dlokit.recording.component_replay import Timeline, feed, read_timeline
from dlokit.recording.reader import RawRecording, read_recording
from dlokit.skills.perception.component import PerceptionComponent
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.results.recording import what_rounds
from dlokit.system.table import component_table, instances_of_run
from dlokit.types.image import DepthImage, StereoImages

PERCEPTION = "perception"
PICTURES = (topics.STEREO_IMAGES, topics.DEPTH_IMAGES)
_PICTURE_NAMES = frozenset(topic.name for topic in PICTURES)

UNCOMPARED_LIVE = ("planning/candidates", "planning/action", "planning.propose")
"""Outputs of live decisions, which end by wall time, so that the amount of search varies."""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The result of a replay."""

    rows: list[FieldRow]
    left_out: int
    """Looks that were not compared, because their pictures are not in the recording."""
    unknown_calls: int
    """Calls that were not repeated, because the recording lacks some of their arguments."""
    uncompared: tuple[str, ...]
    """Topics and skills that cannot be compared."""


def replayable() -> dict[str, tuple[str, ...]]:
    """Components that can be replayed by name, with the sections of the configuration that each is built from."""
    return {row.name: row.replays for row in component_table().values() if row.replays}


def rounded_as_here(path: Path) -> bool:
    """Whether a recording was made with the processor and the versions that this process uses."""
    raw = RawRecording(path=path)
    next(iter(raw), None)  # the metadata is written first
    recorded = raw.metadata.get("versions", {})
    return all(recorded.get(name) == value for name, value in what_rounds().items())


def replay(path: Path, name: str, config: RunConfig) -> Replay:
    """Feed the component `name`, one of `replayable()`, and compare. Raises `InputError`."""
    kind = component_table()[name].load()
    # Pictures are inputs of perception; they come from the camera.
    said = tuple(topic for topic in kind.publishes if topic not in PICTURES)
    line = read_timeline(path, kind, said)
    if not line.published and not line.events:
        raise InputError(f"{path} has no data of {name}: no message that it reads or publishes, and no call of it.")
    camera = PlayedCamera(_pictures(path), _looks(path, line)) if name == PERCEPTION else None
    if camera is not None and camera.empty:
        raise InputError(f"{path} has no pictures, which perception needs; replay into another component.")
    replayed = feed(_build(name, config, camera), line, said, instances_of_run(config))
    left_out = set[int]() if camera is None else camera.left_out
    live = config.runtime == "live"
    uncompared = UNCOMPARED_LIVE if live else ()
    here = rounded_as_here(path)
    return Replay(
        rows=compare(line, replayed, live=live, same_processor=here, left_out=left_out, uncompared=uncompared),
        left_out=len(left_out),
        unknown_calls=line.unknown,
        uncompared=tuple(what for what in uncompared if what.startswith(name)),
    )


def _build(name: str, config: RunConfig, camera: PlayedCamera | None) -> Component:
    if camera is not None:
        return PerceptionComponent(config.perception, camera, config.model, config.mounts, config.scene)
    # No result may depend on the speed of the machine; only the cell and the drivers use the wiring.
    wiring = Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=Path())
    return build_component(name, replace(config, runtime="lockstep"), wiring)


def _pictures(path: Path) -> Iterator[RecordedLook]:
    for one in read_recording(path, _PICTURE_NAMES):
        assert isinstance(one.message, StereoImages | DepthImage)
        yield RecordedLook(log_ns=one.log_ns, images=one.message)


def _looks(path: Path, line: Timeline) -> list[tuple[int, int]]:
    """Stamps of all pictures, and their times; a picture may have a cloud, a recorded image, or both."""
    raw = RawRecording(path=path)
    kept = {record.publish_time: record.log_time for channel, record in raw if channel in _PICTURE_NAMES}
    clouds = {one.message.stamp_ns: one.log_ns for one in line.published}
    return sorted((clouds | kept).items())
