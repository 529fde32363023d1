"""`dlokit.live`: a live system whose skills a script calls."""

import asyncio
import threading
import time
from collections.abc import Coroutine, Generator, Mapping
from concurrent.futures import CancelledError, wait
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, ParamSpec, Self, TypeVar, Unpack

from numpy.typing import ArrayLike

from dlokit.app.console import prepare, progress_console, say
from dlokit.app.library.live_skills import (
    DecisionSkills,
    ModelSkills,
    ObserverSkills,
    PerceptionSkills,
    PlanningSkills,
    RobotSkills,
)
from dlokit.app.library.recording import Recording, open_run
from dlokit.app.shape.questions import TerminalOperator
from dlokit.communication import topics
from dlokit.communication.container import end_tasks
from dlokit.communication.skill import Skill
from dlokit.communication.topic import Topic
from dlokit.errors import ConfigError, DlokitError, ProcessFailure, SkillFailure, require_cell
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import job_from_config, named_or_saved, with_absolute_files
from dlokit.system.live import deciding, started
from dlokit.system.live_system import LiveSystem
from dlokit.system.operator_start import StartOperator, confirmed_start
from dlokit.system.request import NOTHING_OWN, Choices, RunRequest, apart
from dlokit.system.results.run_folder import removed_if_refused, run_folder
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.message import Message
from dlokit.types.observation import Observation
from dlokit.types.robot import RobotState

P = ParamSpec("P")
R = TypeVar("R")
M = TypeVar("M", bound=Message)

_READ_FROM_THE_START: tuple[Topic[Any], ...] = (
    topics.STATE,
    topics.GOAL,
    topics.ROBOT_STATE,
    topics.OBSERVATION,
    topics.VIEWER_PAGE,
)
"""Topics that are subscribed before the first skill is called, so that its effect is seen."""


_ALIVE_EVERY_S = 0.5
"""Interval at which a waiting call checks that the system still runs [s]."""
_CLOUD_WITHIN_S = 5.0
"""Longest wait for the cloud of a successful look [s]; it arrives within milliseconds."""
_DEATH_SEEN_S = 1.0
"""Time after a failed skill to detect the death of a process, which may be the cause [s]."""


class System:
    """A running live system. Skills are methods of its components: `system.perception.look()`.

    A call returns the skill's result at its end. It raises `SkillRejected` if the skill did not start, and
    `SkillFailure` if it did not succeed; both have a named `reason`. Ctrl-C during a call cancels the skill and
    leaves the arm safe.
    """

    def __init__(
        self, config: RunConfig, start_nodes_world: Float64Array, folder: Path, operator: StartOperator
    ) -> None:
        """A system that `live` starts. `operator` confirms the start if a real arm moves."""
        self._operator = operator
        self.folder = folder
        """Folder with the recording."""
        self.perception = PerceptionSkills(self.call, self._observed)
        self.observer = ObserverSkills(self.call)
        self.model = ModelSkills(self.call)
        self.planning = PlanningSkills(self.call)
        self.robot = RobotSkills(self.call)
        self.decision = DecisionSkills(self.call)
        self._config, self._start = config, start_nodes_world
        self._thread = threading.Thread(target=self._serve, name="dlokit live", daemon=True)
        self._up, self._loop = threading.Event(), asyncio.new_event_loop()
        self._closed = asyncio.Event()
        self._live: LiveSystem | None = None
        self.fault: Exception | None = None
        """Cause of an unplanned end, e.g. a process that died; None while the system runs, and after a normal end."""

    @property
    def state(self) -> DloState | None:
        """The estimated shape; None before the first look."""
        return self.latest(topics.STATE)

    @property
    def goal(self) -> GoalShape | None:
        """The goal; None before one is set."""
        return self.latest(topics.GOAL)

    @property
    def robot_state(self) -> RobotState | None:
        """Joints, tool pose and fingers of the first arm; None before its first message."""
        return self.latest(topics.ROBOT_STATE)

    @property
    def page(self) -> str | None:
        """Address of the viewer's page; None without ``viewer=True``."""
        shown = self.latest(topics.VIEWER_PAGE)
        return None if shown is None else shown.url

    def latest(self, topic: Topic[M]) -> M | None:
        """The newest message of a topic of `dlokit.communication.topics`; None before the first."""

        async def read() -> M | None:
            return self._running().transport.latest(topic).value

        return self._wait(read())

    def _observed(self, stamp_ns: int) -> Observation:
        async def read() -> Observation:
            clouds = self._running().transport.stream(topics.OBSERVATION, with_last=True)
            try:
                async with asyncio.timeout(_CLOUD_WITHIN_S):
                    while (seen := await anext(clouds)).stamp_ns < stamp_ns:
                        pass
            except TimeoutError as error:
                raise SkillFailure(
                    "no_cloud", f"the cloud of a look did not arrive within {_CLOUD_WITHIN_S:g} s"
                ) from error
            return seen

        return self._wait(read())

    def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call any skill, e.g. one of your own component; returns its result."""

        async def called() -> R:
            return (await self._running().transport.call(skill, *args, **kwargs)).unwrap(skill.key)

        return self._wait(called())

    def recording(self) -> Recording:
        """The recording; complete after the end of the system."""
        return open_run(self.folder)

    def __enter__(self) -> Self:
        """Start the processes. Raises `ProcessFailure` if one does not start."""
        self._thread.start()
        try:
            self._up.wait()  # bounded by the time-outs of the start
        except KeyboardInterrupt:
            self._end()
            raise
        if self._live is None:
            self._thread.join()
            self._raise()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the processes; the drivers brake and hold the arms. Raises `fault` if there is one."""
        if isinstance(error, SkillFailure):
            time.sleep(_DEATH_SEEN_S)
        self._end()
        if self.fault is not None and (error is None or isinstance(error, SkillFailure)):
            raise self.fault from error  # why the skill failed

    def _end(self) -> None:
        with suppress(RuntimeError):  # it is closed already
            self._loop.call_soon_threadsafe(self._closed.set)
        self._thread.join()

    def _wait(self, work: Coroutine[Any, Any, R]) -> R:
        try:
            future = asyncio.run_coroutine_threadsafe(work, self._loop)
        except RuntimeError:  # the loop is closed
            work.close()
            self._raise()
        try:
            # Bounded by the skill's time-out; a loop that is ending may accept the call and never begin it.
            while not future.done() and self._thread.is_alive():
                wait([future], timeout=_ALIVE_EVERY_S)
            if not future.done():
                self._raise()
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise
        except CancelledError:
            self._thread.join()
            self._raise()

    def _raise(self) -> NoReturn:
        raise self.fault or DlokitError("the system has ended; use it inside the `with` block.")

    def _running(self) -> LiveSystem:
        return self._live or self._raise()

    def _serve(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            try:
                runner.run(self._main())
            except Exception as error:  # raised by the caller's next call, on the caller's thread
                self.fault = error
        self._live = None
        self._up.set()

    async def _main(self) -> None:
        async with started(self._config, self.folder.name, self._start, self.folder) as live:
            await live.run(self._until_closed(live), _fault_of)

    async def _until_closed(self, live: LiveSystem) -> None:
        for topic in _READ_FROM_THE_START:
            live.transport.latest(topic)
        async with deciding(live, self._config, self.folder):
            closed = asyncio.create_task(self._closed.wait(), name="closed")
            start = confirmed_start(live.transport, self._config, self._operator, resumed=False)
            confirming = asyncio.create_task(start, name="confirmed start")
            try:
                await asyncio.wait({closed, confirming}, return_when=asyncio.FIRST_COMPLETED)
                if not confirming.done():
                    return  # Ctrl-C during the questions
                confirming.result()
                self._live = live
                self._up.set()
                await closed
            finally:
                await end_tasks(closed, confirming)


def _fault_of(_: None, failure: ProcessFailure) -> NoReturn:
    raise failure


@contextmanager
def live(
    start: str | Path | ArrayLike = "I",
    *,
    seed: int = 0,
    viewer: bool = False,
    settings: Mapping[str, Any] | None = None,
    config: Path | str | None = None,
    out: Path | str | None = None,
    progress: bool = True,
    operator_confirms: bool = False,
    **choices: Unpack[Choices],
) -> Generator[System]:
    """Start a live system, all processes in real time, whose skills the block calls; stop it at the end.

    The arguments are the same as for `dlokit.shape`; `start` is the DLO's initial shape, which is hidden from the
    system. There is no task: the block calls ``system.decision.shape_dlo("S")`` for one, or single skills. This process
    commands the arms; if it dies or hangs, they brake. `dlokit stop` and `dlokit ps` work on the system. Before a real
    arm may move, an operator must confirm in the terminal, as with `dlokit.shape`.

    Works in a running event loop, which each call blocks. Raises `InputError` if an argument cannot work,
    `ProcessFailure` if a process does not start, or dies, and `StartNotConfirmed` if an operator does not allow a
    real arm to move.
    """
    require_cell("dlokit.live")
    if apart(choices)[1] != NOTHING_OWN:
        raise ConfigError(
            "the processes of a live system do not have a planner or observer of your own: install it in a package "
            "with an entry point."
        )
    chosen = {"seed": seed, "runtime": "live", "headless": not viewer}
    run = RunRequest(config=config, choices=choices, settings={**chosen, **(settings or {})}).configured()
    console = progress_console(progress)
    folder = run_folder(None if out is None else Path(out), "live")
    with removed_if_refused(folder):
        run = replace(run, start=named_or_saved(start, "start", folder))
        run = with_absolute_files(run)
        job = job_from_config(run)
        check_before_start(run, operator_confirms=operator_confirms)
    prepare(console, run)
    with ExitStack() as stack:
        operator = TerminalOperator(confirms=operator_confirms)
        # A spinner would overwrite the questions to the operator.
        with nullcontext() if run.moves_real_arm else console.status("starting the processes"):
            system = stack.enter_context(System(run, job.start_nodes_world, folder, operator))
        say(console, f"running; files: {folder}")
        if viewer and (page := system.page) is not None:
            say(console, f"viewer: {page}")
        yield system
