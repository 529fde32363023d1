"""A recorded run on the viewer's page: with a timeline to play, pause and seek it."""

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from dlokit.communication import topics
from dlokit.communication.timing.clock import LoopClock
from dlokit.recording.channels import ChannelsOf, topic_of
from dlokit.recording.reader import MessagesByTime, Recorded, files_of
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.playback import Mark, MarkKind, Player, RunTimeline, waits_between
from dlokit.system.build import Wiring, assemble, build_viewer
from dlokit.system.config import RunConfig
from dlokit.types.flow import FlowStatus
from dlokit.types.robot import RobotState

WATCHED_PARTS = ("viewer", "model", "task")
"""Sections of the configuration that the viewer is built from."""
_EVERY = frozenset({topics.FLOW.name, topics.RUN.name})
"""Topics whose every message the page uses, for its plot and its log; for other topics, only the last one counts."""
_TICK_S = 1.0 / 30.0
"""Time between two steps of the player [s]."""
_LOOK_NS = 100_000_000
"""Time between two states that are compared [ns]."""
_MOVED_RAD, _MOVED_M = 5e-4, 2e-4
"""Minimum change of a joint or of the fingers between two states of a moving arm; above the noise of sensors."""
_LARGE_MB = 50.0
"""Recordings larger than this take more than a second to read [MB]."""
_AFTER_S, _BEFORE_S = 0.7, 1.0
"""Parts of a wait that are played: at its beginning and at its end [s]."""


def watch(path: Path, config: RunConfig, speed: float, port: int | None, say: Callable[[str], None]) -> None:
    """Serve the page of the recording `path`, and wait for Ctrl-C; it plays when a browser opens the page.

    The page is served on this machine alone, at `port` or the configured one. Raises `InputError` when the file is not
    a recording of a run, `MachineError` when the port is not available.
    """
    # The configured address comes from another machine or person: it must not open this page to the network.
    viewer = ViewerConfig(port=config.viewer.port if port is None else port)
    config = replace(config, viewer=viewer)
    try:
        asyncio.run(show(path, config, speed, say))
    except KeyboardInterrupt:
        say("the page is closed")


async def show(path: Path, config: RunConfig, speed: float, say: Callable[[str], None]) -> None:
    """As `watch`, until cancelled."""
    size_mb = sum(file.stat().st_size for file in files_of(path)) / 1e6
    if size_mb > _LARGE_MB:
        say(f"reading {size_mb:.0f} MB")
    run = RecordedRun(path, speed)
    viewer = build_viewer(config, operated=False, player=run.player, folder=path.parent)
    async with assemble(["viewer"], config, Wiring(), build=lambda *_: viewer) as host, host.guarded():
        await _play(run, viewer, say)


async def _play(run: "RecordedRun", viewer: ViewerComponent, say: Callable[[str], None]) -> None:
    await viewer.opened.wait()
    say(f"viewer: {viewer.url}")
    clock = LoopClock()
    last_ns = clock.now_ns()
    while True:
        now_ns = clock.now_ns()
        await run.show_next(viewer, (now_ns - last_ns) / 1e9)
        last_ns = now_ns
        await clock.sleep(_TICK_S)


class RecordedRun:
    """A recorded run, and the player that moves through it."""

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        """Raises `InputError` when the file is not a recording of a run."""
        self._messages = MessagesByTime(path, ChannelsOf(topic.name for topic in ViewerComponent.subscribes()), _EVERY)
        self.player = Player(timeline=timeline_of(self._messages, path), speed=speed)
        self._shown_ns: int | None = None
        self._begun = False

    async def show_next(self, viewer: ViewerComponent, elapsed_s: float) -> None:
        """Advance by `elapsed_s` seconds, and pass the viewer the messages that it would have received until then.

        The run begins to play when a browser opens the page for the first time.
        """
        player = self.player
        if viewer.visited.is_set() and not self._begun:
            self._begun = True
            player.play()
        player.advance(elapsed_s)
        if player.jumped:
            player.jumped, self._shown_ns = False, None
            viewer.forget()
        until_ns = player.timeline.begin_ns + round(player.position_s * 1e9)
        handlers = {topic.name: method for topic, method in viewer.handlers().items()}
        for one in self._messages.due(self._shown_ns, until_ns):
            topic = topic_of(one.topic)
            assert topic is not None, f"{one.topic} is one of the topics read"
            await getattr(viewer, handlers[topic.row])(one.message)
        self._shown_ns = until_ns


def timeline_of(messages: MessagesByTime, path: Path) -> RunTimeline:
    """The timeline of a recorded run: its steps, actions and ends, and the waits in which no arm moves."""
    duration_s = (messages.last_ns - messages.first_ns) / 1e9
    waits = waits_between(_moving_s(messages), duration_s, after_s=_AFTER_S, before_s=_BEFORE_S)
    about = messages.metadata.get("run", {})
    return RunTimeline(
        name=about.get("name", path.parent.name),
        recorded_at=time.strftime("ended %Y-%m-%d %H:%M", time.localtime(path.stat().st_mtime)),
        begin_ns=messages.first_ns,
        duration_s=duration_s,
        marks=tuple(sorted(_marks(messages), key=lambda mark: mark.time_s)),
        waits=waits,
    )


def _marks(messages: MessagesByTime) -> Iterator[Mark]:
    """The beginnings of steps and of actions, and the ends of tasks.

    An action begins when it is chosen; a chosen action that was dropped for a better one does not count.
    """
    chosen_s = [_time_s(messages, one) for one in messages.of(topics.ACTION.name)]
    step, actions, task = "", 0, 1
    for one in messages.of(topics.FLOW.name):
        assert isinstance(one.message, FlowStatus)
        status, time_s = one.message, _time_s(messages, one)
        if status.actions > actions:
            begin_s = next((each for each in reversed(chosen_s) if each < time_s), time_s)
            yield Mark(time_s=begin_s, kind=MarkKind.ACTION, name=f"task {task}, action {status.actions}")
        actions = status.actions
        if status.step != step:
            step = status.step
            yield Mark(time_s=time_s, kind=MarkKind.STEP, name=step.replace("_", " "))
        if status.outcome is not None:
            yield Mark(time_s=time_s, kind=MarkKind.END, name=f"task {task}: {status.outcome.value}")
            step, actions, task = "", 0, task + 1


def _time_s(messages: MessagesByTime, one: Recorded) -> float:
    return (one.log_ns - messages.first_ns) / 1e9


def _moving_s(messages: MessagesByTime) -> list[float]:
    """Times [s] at which an arm moves, in order."""
    moving: list[float] = []
    for channel in messages.channels:
        topic = topic_of(channel)
        if topic is None or topic.row != topics.ROBOT_STATE.name:
            continue
        before: RobotState | None = None
        for one in messages.of(channel, min_gap_ns=_LOOK_NS):
            assert isinstance(one.message, RobotState)
            if before is not None and _moved(before, one.message):
                moving.append(_time_s(messages, one))
            before = one.message
    return sorted(moving)


def _moved(before: RobotState, now: RobotState) -> bool:
    turned = bool(np.abs(now.q_rad - before.q_rad).max() > _MOVED_RAD)
    return turned or abs(now.finger_width_m - before.finger_width_m) > _MOVED_M
