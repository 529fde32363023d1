"""The table of faults, a row each: what goes wrong, when, and how a run may end that it happens to."""

import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from dlokit.bench.faults.disturbance import Disturbance
from dlokit.bench.faults.injuries import Disturbed, FullDisk, Injury, Nothing, Signalled, SlippedGrasp
from dlokit.bench.faults.moments import Moment
from dlokit.types.flow import RunOutcome


@dataclass(frozen=True)
class Ending:
    """One right end of a run."""

    outcome: RunOutcome
    reason: str = ""
    """How its reason begins."""

    def __str__(self) -> str:
        return f"{self.outcome.value}, {self.reason}" if self.reason else self.outcome.value


CONVERGES = (Ending(RunOutcome.CONVERGED),)


def ends_as(*reasons: str) -> tuple[Ending, ...]:
    """The run fails by one of these names; `robot.` is any skill of the robot's that was not answered."""
    return tuple(Ending(RunOutcome.FAILED, reason) for reason in reasons)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One row."""

    name: str
    what: str
    injury: Callable[[], Injury]
    when: tuple[Moment, ...] = (Moment.ANY,)
    """The runs of a fault take these in turn."""
    over_after_s: float | None = None
    """When it is over by itself [s of the machine's clock]; None: it is not."""
    right: tuple[Ending, ...] = CONVERGES
    """Right ends; of the run that goes on with it, where it is resumed."""
    resumed: bool = False
    """It ends the run's own process: all others must end by themselves, and `dlokit resume` must go on."""
    brakes: bool = False
    """An arm that moves when it comes must brake by itself; how soon it begins is measured."""
    takes_arm: bool = False
    """The cell, and the arm with it, is gone afterwards: nobody can say whether it stands."""
    watched: bool = False
    """The run has a viewer."""
    disturbed: bool = False
    """The run's processes are started with a bus that can be disturbed."""


KILL, STOP = signal.SIGKILL, signal.SIGSTOP
ANY, MOVING, HOLDING, THINKING = Moment.ANY, Moment.MOVING, Moment.HOLDING, Moment.THINKING
FROZEN_S = 5.0
"""What is frozen for a while is so for this long [s]."""


LATE_FOR_S = 10.0
NO_FEEDBACK_S = 2.0
"""More than the gate waits for feedback before a motion [s]."""


def _to(process: str, number: signal.Signals, *, worker: bool = False) -> Callable[[], Injury]:
    return partial(Signalled, process, number, worker)


# fmt: off
FAULTS: tuple[Fault, ...] = (
    Fault(name="none",              what="nothing (control)", injury=Nothing),
    Fault(name="kill-decision",     what="SIGKILL to the decision process", injury=_to("decision", KILL),
          when=(MOVING, ANY, HOLDING), resumed=True, brakes=True),
    Fault(name="freeze-decision",   what="SIGSTOP to the decision process, for 5 s", injury=_to("decision", STOP),
          when=(MOVING, ANY, HOLDING), over_after_s=FROZEN_S, brakes=True),
    Fault(name="kill-robot",        what="SIGKILL to the robot's process", injury=_to("robot", KILL),
          when=(MOVING, ANY), right=ends_as("process_died: robot"), brakes=True),
    Fault(name="freeze-robot",      what="SIGSTOP to the robot's process", injury=_to("robot", STOP),
          when=(MOVING, ANY), right=ends_as("process_frozen: robot", "robot."), brakes=True),
    Fault(name="kill-cell",         what="SIGKILL to the cell's process", injury=_to("cell", KILL),
          when=(MOVING, ANY), right=ends_as("process_died: cell"), takes_arm=True),
    Fault(name="freeze-cell",       what="SIGSTOP to the cell's process", injury=_to("cell", STOP),
          when=(MOVING, ANY), right=ends_as("process_frozen: cell", "robot."), takes_arm=True),
    Fault(name="kill-camera",       what="SIGKILL to the camera's process", injury=_to("camera", KILL)),
    Fault(name="freeze-camera",     what="SIGSTOP to the camera's process", injury=_to("camera", STOP)),
    Fault(name="kill-observer",     what="SIGKILL to the observer's process", injury=_to("observer", KILL)),
    Fault(name="freeze-observer",   what="SIGSTOP to the observer's process", injury=_to("observer", STOP)),
    Fault(name="kill-simulation",   what="SIGKILL to the model's process", injury=_to("simulation", KILL)),
    Fault(name="freeze-simulation", what="SIGSTOP to the model's process", injury=_to("simulation", STOP)),
    Fault(name="kill-viewer",       what="SIGKILL to the viewer's process", injury=_to("viewer", KILL), watched=True),
    Fault(name="freeze-viewer",     what="SIGSTOP to the viewer's process", injury=_to("viewer", STOP), watched=True),
    Fault(name="kill-planner",      what="SIGKILL to the worker that plans",
          injury=_to("decision", KILL, worker=True), when=(THINKING,)),
    Fault(name="freeze-planner",    what="SIGSTOP to the worker that plans",
          injury=_to("decision", STOP, worker=True), when=(THINKING,)),
    Fault(name="drop-camera",       what="no pictures for 5 s", injury=_to("camera", STOP), over_after_s=FROZEN_S),
    Fault(name="withhold-feedback", what="no feedback of the arm reaches its driver for 2 s",
          injury=partial(Disturbed, Disturbance.NO_FEEDBACK), when=(MOVING,), over_after_s=NO_FEEDBACK_S,
          disturbed=True, brakes=True),
    Fault(name="slip-grasp",        what="the DLO falls out of the fingers", injury=SlippedGrasp, when=(HOLDING,)),
    Fault(name="delay-messages",    what="all messages and calls come 500 ms late, for 10 s",
          injury=partial(Disturbed, Disturbance.LATE), over_after_s=LATE_FOR_S, disturbed=True),
    Fault(name="fill-disk",         what="the recording may not grow any more", injury=FullDisk),
)
# fmt: on

BY_NAME = {fault.name: fault for fault in FAULTS}
