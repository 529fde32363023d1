"""Runs every method on every case: the same clouds for all, frame by frame, timed, in separate processes.

The linear algebra of each process uses one thread.
"""

import os
import queue
import signal
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec
import numpy as np
from loky.backend import get_context, resource_tracker

from dlokit.communication.timing.urgency import ONE_THREAD
from dlokit.communication.zenoh.session import check_shared_memory
from dlokit.errors import DlokitError, InputError, MachineError
from dlokit.extras.bench.observers.cases import ObserverCase
from dlokit.extras.bench.observers.clouds import Looks, ObserverFrame
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.methods import ObserverMethod
from dlokit.extras.bench.observers.metrics import Losses, Track, losses, score
from dlokit.extras.bench.observers.sequence import Sequence, lengths_between_m
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, memory_flaw, nothing_seen, prior_from, without_memory
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.skills.observer.visibility import distance_to_dlo_m
from dlokit.system.signals import OF_TERMINAL, terminal_signals_blocked
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation

WARM_UP_FRAMES = 3

ReportProgress = Callable[[str, int, int], None]
"""Reports the progress of a long trial: its method, finished frames, all frames."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The result of one method in one case with one seed."""

    case: str
    seed: int
    method: str
    frames: int
    figures: dict[str, float]
    losses: Losses | None = None
    """None if the method states no health."""


@dataclass(frozen=True, kw_only=True)
class SeededCase:
    """One case with one seed, for every method."""

    case: ObserverCase
    seed: int


@dataclass(frozen=True, kw_only=True)
class BenchPlan:
    """The plan of a run: methods, cases, seeds and frames."""

    cases: tuple[ObserverCase, ...]
    methods: tuple[ObserverMethod, ...]
    seeds: int
    frames: int | None
    """Length of a sequence; None for all of an external one."""
    first_seed: int = 0

    @property
    def seeded_cases(self) -> tuple[SeededCase, ...]:
        """Seed by seed, so that an interrupted run covers all cases; a file has one seed."""
        return tuple(
            SeededCase(case=case, seed=seed)
            for seed in range(self.first_seed, self.first_seed + self.seeds)
            for case in self.cases
            if case.file is None or seed == self.first_seed
        )

    @property
    def trials(self) -> int:
        """Total number of trials."""
        return len(self.methods) * len(self.seeded_cases)


class Sequences:
    """The sequences of one seed after another: most cases differ only in their clouds."""

    def __init__(self, frames: int | None) -> None:
        """Sequences of at most `frames` frames."""
        self._frames = frames
        self._seed: int | None = None
        self._made: dict[tuple[str, float], Sequence] = {}

    def of(self, seeded: SeededCase) -> Sequence:
        """The sequence of a case and seed, simulated or read once."""
        if seeded.seed != self._seed:
            self._made.clear()
            self._seed = seeded.seed
        key = (str(seeded.case.file or seeded.case.motion), seeded.case.pace)
        if key not in self._made:
            self._made[key] = seeded.case.sequence(seeded.seed, self._frames)
        return self._made[key]


def run_seeded_case(
    seeded: SeededCase, sequence: Sequence, methods: tuple[ObserverMethod, ...], report: ReportProgress | None = None
) -> Iterator[Trial]:
    """The trials of one case with one seed: every method gets the same clouds."""
    seen = Looks(sequence, seeded.case.conditions, seeded.seed)
    for method in methods:
        track = follow(sequence, seen, method, report)
        stated = None
        if track.health is not None:
            stated = losses(track.lost, track.health, ObserverConfig().lost_health)
        yield Trial(
            case=seeded.case.name,
            seed=seeded.seed,
            method=method.name,
            frames=len(seen),
            figures=dict(score(track)),
            losses=stated,
        )


def follow(
    sequence: Sequence, seen: Looks | list[ObserverFrame], method: ObserverMethod, report: ReportProgress | None = None
) -> Track:
    """Track a sequence from its first frame's nodes on; each prior is the previous frame's targets."""
    topology = sequence.topology
    state = DloState(stamp_ns=seen[0].seen.stamp_ns, nodes_world=sequence.nodes_world[0].copy(), topology=topology)
    _warm_up(method, sequence.dlo, seen[:WARM_UP_FRAMES], state)
    strategy, in_component = method.config.build(sequence.dlo), method.config.build(sequence.dlo)
    answers: list[TargetPoints] = []
    visible = np.zeros((len(seen) - 1, sequence.count), dtype=np.bool_)
    seconds, component_s, cloud_m, length_error = np.zeros((4, len(seen) - 1))
    truth_unknown = not np.isfinite(sequence.nodes_world).all()
    length_m = float(topology.rest_lengths_m.sum())
    dark, failed = np.zeros((2, len(seen) - 1), dtype=np.bool_)
    for frame in range(1, len(seen)):
        look = seen[frame]  # one at a time: the frames of a long sequence do not fit into memory
        visible[frame - 1], dark[frame - 1] = look.visible, look.dark
        answer, seconds[frame - 1] = _timed(strategy, _given(method, look), state)
        if method.states_trust:
            component_s[frame - 1] = _followed_s(in_component, _given(method, look), state)
        failed[frame - 1] = answer is None
        targets = without_memory(nothing_seen(look.seen, state)) if answer is None else answer
        answers.append(targets)
        if truth_unknown:
            cloud_m[frame - 1] = _cloud_m(look.seen, targets, topology)
            length_error[frame - 1] = lengths_between_m(targets.nodes_world).sum() / length_m - 1.0
        state = prior_from(targets, topology)
        if report is not None:
            report(method.name, frame, len(seen) - 1)
    return Track(
        nodes_world=np.array([targets.nodes_world for targets in answers]),
        true_world=sequence.nodes_world[1:],
        visible=visible,
        seconds=seconds,
        component_s=component_s if method.states_trust else None,
        dark=dark,
        failed=failed,
        cloud_m=cloud_m,
        length_error=length_error,
        health=np.array([targets.health for targets in answers]) if method.states_trust else None,
        stated_m=_stated_m(answers) if method.states_trust else None,
    )


def _cloud_m(seen: Observation, targets: TargetPoints, topology: Topology) -> float:
    """Mean distance of a cloud's points to the line through the nodes [m]; NaN without points."""
    points = seen.points_world.astype(np.float64)
    return float(distance_to_dlo_m(points, targets.nodes_world, topology).mean()) if len(points) else np.nan


def _stated_m(answers: list[TargetPoints]) -> Float64Array | None:
    """The stated standard deviation of each node (T, K) [m]: the root of its covariance's trace."""
    if all(targets.covariance is None for targets in answers):
        return None
    unknown = np.full(len(answers[0].nodes_world), np.nan)
    traces = [
        unknown if targets.covariance is None else np.trace(targets.covariance, axis1=1, axis2=2) for targets in answers
    ]
    return np.sqrt(np.maximum(np.array(traces), 0.0))


def _followed_s(strategy: ObserverStrategy, seen: Observation, state: DloState) -> float:
    """Processor time [s] of the observer component for a cloud, including the strategy's estimate."""
    began = time.process_time()
    followed(strategy, seen, state, ObserverConfig())
    return time.process_time() - began


def _warm_up(method: ObserverMethod, dlo: BelievedDlo, seen: list[ObserverFrame], state: DloState) -> None:
    """Run the first calls untimed, because they load or compile code."""
    strategy = method.config.build(dlo)
    for look in seen:
        _timed(strategy, _given(method, look), state)


def _given(method: ObserverMethod, look: ObserverFrame) -> Observation:
    return msgspec.structs.replace(look.seen, pins=look.pins) if method.pinned else look.seen


def _timed(strategy: ObserverStrategy, seen: Observation, state: DloState) -> tuple[TargetPoints | None, float]:
    """An answer and its processor time [s]; None without a finite answer.

    A package that fails at one frame (a singular matrix) loses that frame, not hours of the other methods' work.
    """
    # Processor time of the process: it includes a method's threads, and no other processes.
    began = time.process_time()
    try:
        targets = strategy.estimate(seen, state)
    except (ArithmeticError, ValueError):
        return None, time.process_time() - began
    taken_s = time.process_time() - began
    if (flaw := memory_flaw(targets.memory)) is not None:
        raise InputError(f"The targets of {type(strategy).__name__} are refused: {flaw}.")
    usable = targets.nodes_world.shape == state.nodes_world.shape and bool(np.all(np.isfinite(targets.nodes_world)))
    return targets if usable else None, taken_s


THREAD_VARIABLES = (*ONE_THREAD, "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables that BLAS libraries, OpenMP and Numba read when they are loaded."""
_REPORTED_EVERY_S = 1.0
_LOOKED_AFTER_EVERY_S = 1.0


@dataclass(frozen=True, kw_only=True)
class TrialStage:
    """Progress of a running trial."""

    case: str
    seed: int
    method: str
    frame: int
    frames: int


@dataclass(frozen=True, kw_only=True)
class SampledTimes:
    """The wall time of a few frames of a plan's first case."""

    sequence_s: float
    """Time to simulate or read a sequence of `REHEARSED` frames [s]."""
    look_s: float
    """Time to make one cloud [s]."""
    frame_s: float
    """Time of all methods for one cloud [s]."""

    def duration_s(self, plan: BenchPlan) -> float:
        """Estimate the time of a plan in one process [s]: within a factor of two on a machine without other load."""
        made: set[tuple[int, str, float]] = set()
        total_s = 0.0
        for seeded in plan.seeded_cases:
            case = seeded.case
            frames = plan.frames or case.sequence(seeded.seed, None).frames
            total_s += frames * (self.look_s + self.frame_s * case.conditions.points / _REHEARSED_POINTS)
            key = (seeded.seed, str(case.file or case.motion), case.pace)
            if key not in made:
                total_s += self.sequence_s * (1.0 + max(frames - REHEARSED, 0) / _FRAMES_LIKE_BEGINNING)
                made.add(key)
        return total_s


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The estimated time of a plan, in one process, before its first trial."""

    seconds: float


REHEARSED = 4
"""Frames from which the time of a plan is estimated."""
_REHEARSED_POINTS = Conditions().points
_FRAMES_LIKE_BEGINNING = 20.0
"""Simulated frames that take as long as the model and its first `REHEARSED` frames."""


def rehearse(plan: BenchPlan) -> SampledTimes:
    """Run a few frames of the first case with every method, twice: the first time loads or compiles code."""
    first = plan.seeded_cases[0]
    began_s = time.perf_counter()
    sequence = first.case.sequence(first.seed, REHEARSED)
    sequence_s = time.perf_counter() - began_s
    seen = Looks(sequence, first.case.conditions, first.seed)
    began_s = time.perf_counter()
    frames = seen[:REHEARSED]
    look_s = (time.perf_counter() - began_s) / len(frames)
    for method in plan.methods:
        follow(sequence, frames, method)
    began_s = time.perf_counter()
    for method in plan.methods:
        follow(sequence, frames, method)
    # Each frame after the first is answered twice by most methods, and the warm-up once.
    answered = len(frames) - 1 + min(WARM_UP_FRAMES, len(frames)) / 2.0
    scale = _REHEARSED_POINTS / first.case.conditions.points
    frame_s = (time.perf_counter() - began_s) / answered * scale
    return SampledTimes(sequence_s=sequence_s, look_s=look_s, frame_s=frame_s)


Said = Estimate | Trial | TrialStage
Result = TypeVar("Result")


def run_in_workers(plan: BenchPlan, jobs: int) -> Generator[Said]:
    """Rehearse, then run all trials, `jobs` cases in parallel, and report the progress of long ones.

    Closing the iterator ends the processes. Raises what a trial raised, `MachineError` when a process died.
    """
    context = _fresh_processes()
    work: Any = context.Queue()
    progress: Any = context.Queue()
    for item in (rehearse, *plan.seeded_cases, *([None] * jobs)):
        work.put(item)
    workers = [context.Process(target=_work, args=(plan, work, progress), daemon=True) for _ in range(jobs)]
    try:
        with one_thread():
            for worker in workers:
                worker.start()
        missing = plan.trials
        while missing > 0:
            item = _next(progress, workers)
            if isinstance(item, BaseException):
                raise item
            missing -= isinstance(item, Trial)
            yield item
    finally:
        for worker in workers:
            worker.terminate()
        for done in (work, progress):
            done.cancel_join_thread()


def in_a_worker(work: Callable[[], Result]) -> Result:
    """Call a function of a module in a process whose linear algebra uses one thread."""
    with one_thread(), ProcessPoolExecutor(1, mp_context=_fresh_processes()) as pool:
        return pool.submit(work).result()


def _fresh_processes() -> Any:
    """A context of fresh processes.

    A forked process would keep this process's thread settings; a spawned one of `multiprocessing` would run the calling
    script again, and would lack the classes that the script defines.
    """
    check_shared_memory()
    with terminal_signals_blocked():  # the pool's cleanup
        resource_tracker.ensure_running()
    return get_context("loky")


def _next(progress: Any, workers: list[Any]) -> Any:
    while True:
        try:
            return progress.get(timeout=_LOOKED_AFTER_EVERY_S)
        except queue.Empty:
            codes = [worker.exitcode for worker in workers if worker.exitcode]
            if codes:
                raise MachineError(
                    f"A process of the bench ended with code {codes[0]}, perhaps because of too little memory: "
                    "use fewer --jobs or shorter sequences (--frames)."
                ) from None


def _work(plan: BenchPlan, work: Any, progress: Any) -> None:
    for number in OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    sequences = Sequences(plan.frames)
    for seeded in iter(work.get, None):
        try:
            if seeded is rehearse:
                progress.put(Estimate(seconds=rehearse(plan).duration_s(plan)))
                continue
            for trial in run_seeded_case(seeded, sequences.of(seeded), plan.methods, _reporter_of(seeded, progress)):
                progress.put(trial)
        except DlokitError as error:
            progress.put(error)
        except Exception:  # the other process handles it
            progress.put(RuntimeError(traceback.format_exc()))


def _reporter_of(seeded: SeededCase, progress: Any) -> Any:
    last_s = time.monotonic()

    def report(method: str, frame: int, frames: int) -> None:
        nonlocal last_s
        if time.monotonic() - last_s > _REPORTED_EVERY_S:
            last_s = time.monotonic()
            progress.put(TrialStage(case=seeded.case.name, seed=seeded.seed, method=method, frame=frame, frames=frames))

    return report


@contextmanager
def one_thread() -> Generator[None]:
    """A context in which started processes use one thread for linear algebra, despite the user's settings."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
