"""Terminal output of a run: a live table of actions, the current step, and the summary at the end.

If the output is not a terminal (a log file, a pipe), one plain line per action is written instead.
"""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from dlokit.app.console import say
from dlokit.app.shape.outcome_text import (
    ACTION_COLUMNS,
    Tone,
    explain_outcome,
    explain_recoveries,
    grip_text,
    millimetres,
    when_true,
)
from dlokit.system.operator_start import RealStart, StartOperator
from dlokit.system.results.run_result import FILE_NAME as RESULT_FILE
from dlokit.system.results.run_result import (
    GOAL_FILE_NAME,
    NEAREST_FILE_NAME,
    REPORT_FILE,
    ActionResult,
    RunRecord,
    RunResult,
)
from dlokit.system.shaping import Watcher, task_end
from dlokit.system.signals import LastResort
from dlokit.types.action import Candidates
from dlokit.types.feasibility import Standing
from dlokit.types.flow import FlowStatus, RunOutcome, TaskEnd

_END = "“End run” on the page or Ctrl-C ends the run"
Keep = Callable[[int, RunRecord], tuple[RunRecord, Path]]
"""(number, record) → (judged record, folder of the task's files)."""
TASK_FILES = (REPORT_FILE, RESULT_FILE, GOAL_FILE_NAME, NEAREST_FILE_NAME)
"""Files of a task, in the order in which the page lists them."""


def _line(text: str, more: str = "", color: str = "cyan") -> Text:
    return Text.assemble(("▸ ", color), (text, f"bold {color}"), (f"   {more}" if more else "", "dim"))


_NEXT_GOAL = _line("waiting for the next goal on the page", _END)
_ENDING = _line("ending")
_STOPPED = _line("the arms are stopped", color="red")
_STOPPED_AND_STAYS = _line(
    "the arms are stopped",
    "check that no person is within reach, then press “Enable arms” on the page, or run dlokit enable",
    "red",
)

_WARNS = frozenset({"find_dlo", "set_goal", "track_model"})
"""Steps at which messages about the camera or the goal are printed for the operator."""


class RunDisplay(Watcher):
    """Shows one run in the terminal. Use it as a context manager around the run."""

    def __init__(
        self,
        console: Console,
        *,
        title: str,
        threshold_m: float,
        invitation: str = "",
        operator: StartOperator | None = None,
        keep: Keep | None = None,
        last_resort: LastResort | None = None,
        starts: str = "",
        stays: bool = False,
    ) -> None:
        """Show a run named `title` on `console`; errors below `threshold_m` are marked.

        `starts` says what a start takes. A run that `stays` has several tasks, each with its own table, and its stopped
        arms are enabled again.
        `invitation` is the advice for the viewer, once it is available. `operator` confirms the start of a run with a
        real arm; None: the run does not start. `keep` judges the record of a task in a run of several tasks and writes
        its files; it may take seconds. `last_resort` ends the program where the run does not end in order; None: the
        program is not ours to end.
        """
        self._last_resort = last_resort
        self._starts, self._stays = starts, stays
        self._keep = keep
        self._operator = operator
        self._page: str | None = None
        self._console = console
        self._invitation = invitation
        self._title = title
        self._threshold_m = threshold_m
        self._rows: list[ActionResult] = []
        self._status: FlowStatus | None = None
        self._task = 1
        self._ended = self._ending = self._stopped = False
        self._between_tasks = False
        self._candidates: Candidates | None = None
        # Refreshed on events instead of by a thread, because a run owns its process. The table at the end, which has
        # the evaluator's column, replaces it.
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None

    def __enter__(self) -> Self:
        if self._live is None:
            self._console.print(f"{self._title}: threshold {millimetres(self._threshold_m)}", markup=False)
        else:
            self._live.start()
            self._refresh()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._ended = True
            self._refresh()
            self._live.stop()

    async def confirm(self, start: RealStart) -> None:
        """Let the operator confirm the start of a run with a real arm; the questions replace the live table."""
        if self._operator is None:
            await super().confirm(start)
            return
        if self._live is not None:
            self._live.stop()
        self._page = await start.page()  # shown to the operator with the questions
        try:
            await self._operator.confirm(start)
        finally:
            if self._live is not None:
                self._live.start()
                self._refresh()

    def page(self, url: str) -> None:
        """Print the viewer's address, unless it was printed before."""
        if url == self._page:
            return
        self._page = url
        say(self._console, f"viewer: {url}")
        if self._invitation:
            self._console.print(self._invitation, markup=False, highlight=False)

    def step(self, status: FlowStatus) -> None:
        """Show the new step of the flow."""
        if self._live is None and status.step in _WARNS and status.text:
            say(self._console, status.text)
        self._status, self._candidates, self._between_tasks = status, None, False
        self._refresh()

    def considered(self, candidates: Candidates) -> None:
        """Show the progress of a decision."""
        self._candidates = candidates
        self._refresh()

    def action(self, row: ActionResult) -> None:
        """Add an ended action."""
        self._rows.append(row)
        if self._live is None:
            self._console.print(_plain(row), markup=False, highlight=False)
        self._refresh()

    def arms_stopped(self, stopped: bool) -> None:
        """Say that the arms are stopped and how they are enabled, until they are."""
        self._stopped = stopped
        if self._live is None:
            self._console.print(self._stop_line() if stopped else _line("the arms are enabled"), highlight=False)
        self._refresh()

    def stopping(self, by: str) -> None:
        """Say what happens and for how long at most, because the orderly end takes some seconds."""
        self._ending = True
        self._refresh()
        limit = "" if self._last_resort is None else f", {self._last_resort.begin()}"
        # In two lines: a terminal of 80 columns would break one between a number and its unit.
        say(self._console, f"{by}: the arms brake, the system ends and the files are written;")
        say(self._console, f"some seconds{limit}")

    def interrupted_again(self) -> None:
        """Say what one more Ctrl-C costs; end the program at that one."""
        if self._last_resort is not None:
            self._last_resort.press()

    async def ended(self, number: int, record: RunRecord) -> TaskEnd:
        """Keep the files of a task in a run of several tasks, and print its outcome."""
        # Before the record contains the truth, which no message may carry.
        text = explain_outcome(record.result, figures=False)
        if self._keep is None:
            return task_end(number, record, text=text)
        # The page and the heartbeats continue meanwhile.
        judged, out = await asyncio.to_thread(self._keep, number, record)
        report, nearest = out / REPORT_FILE, out / NEAREST_FILE_NAME
        self._console.print(f"\ntask {number}: to {record.result.goal or 'no goal'}", markup=False, highlight=False)
        self.finish(judged.result, report if report.exists() else None, nearest if nearest.exists() else None)
        self._rows, self._status, self._candidates = [], None, None
        self._task, self._between_tasks = number + 1, True
        if self._live is None and not self._ending:
            if self._stopped:
                self._console.print(self._stop_line(), highlight=False)
            self._console.print(_NEXT_GOAL, highlight=False)
        self._refresh()
        files = [Path(out.name) / name for name in TASK_FILES if (out / name).exists()]
        end = task_end(number, record, text=text, files=files)
        return msgspec.structs.replace(end, folder=str(out.parent.absolute()))

    def closed(self, folder: Path, report: Path | None) -> None:
        """Print where the files of a run that took several goals are."""
        say(self._console, f"the run has ended; each task has a folder in {folder}")
        if report is not None:
            say(self._console, f"report of the last task: {report}")

    def finish(self, result: RunResult, report: Path | None = None, nearest: Path | None = None) -> None:
        """Print the table, the outcome, the path of the report, and the nearest feasible goal.

        Call it after the `with` block.
        """
        if result.history:
            self._console.print(self._table(result.history, "" if self._stays else self._title))
        color = "green" if result.outcome.is_success else "red"
        self._print(f"[bold {color}]{result.outcome.value}[/]  {escape(explain_outcome(result))}")
        if when := when_true(result):
            self._print(f"true error {millimetres(result.true_rmse_m)}, {when}")
        if result.camera is not None and self._live is not None:  # otherwise it has been printed before
            self._print(escape(result.camera.text))
        for why in result.interruptions:
            self._print(f"[bold yellow]interrupted[/]  {escape(why)}")
        if result.recoveries:
            self._print(f"[bold yellow]recovered[/]  {escape(explain_recoveries(result))}")
        pace = result.sim_time_s / result.wall_time_s if result.wall_time_s > 0.0 else 0.0
        clock = f"{result.sim_time_s:.1f} s on the run's clock in {result.wall_time_s:.1f} s"
        self._print(f"{clock} ({pace:.1f} times real time)")
        verdict = result.goal_verdict if result.outcome is not RunOutcome.INFEASIBLE else None
        if verdict is not None and verdict.standing is not Standing.HOLDS:
            self._print(f"[bold yellow]{escape(verdict.text)}[/]")
        if nearest is not None:
            say(self._console, f"nearest feasible goal: {nearest}")
        if report is not None:
            # Paths are not wrapped, so that they can be clicked and copied.
            say(self._console, f"report: {report}")

    def incomplete(self, folder: Path, unwritten: Mapping[str, str], again: str) -> None:
        """Print the unwritten files, the kept files, and what to do; `again` is the command of the run."""
        self._console.print(Text(missing_files(folder, unwritten, again), style="red"), highlight=False, soft_wrap=True)

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False)

    def _table(self, rows: Sequence[ActionResult], title: str) -> Table:
        framed = self._console.width >= FRAMED_WIDTH
        return action_table(rows, threshold_m=self._threshold_m, title=title, framed=framed)

    def _stop_line(self) -> Text:
        return _STOPPED_AND_STAYS if self._stays else _STOPPED

    def _refresh(self) -> None:
        if self._live is not None:
            self._live.update(self._view(), refresh=True)

    def _view(self) -> RenderableType:
        title = f"task {self._task}" if self._stays else self._title
        # Without rows a table is a head only, which some terminals keep in their scroll-back.
        parts = list[RenderableType]([self._table(self._rows, title)] if self._rows else [])
        if not self._ended:
            parts += ([] if self._rows or self._between_tasks else [Text(title, "bold")]) + self._now()
        return Group(*parts)

    def _now(self) -> list[RenderableType]:
        if self._ending:
            return [_ENDING]
        stop = list[RenderableType]([self._stop_line()] if self._stopped else [])
        if self._between_tasks:
            return [*stop, _NEXT_GOAL]
        if self._status is None:
            return [*stop, _line("starting", self._starts)]
        return stop or [_progress(self._status, self._candidates)]


FRAMED_WIDTH = 76
"""Width of the table of actions with its frame [characters]; a narrower terminal gets it unframed, in 60."""


def action_table(rows: Sequence[ActionResult], *, threshold_m: float, title: str = "", framed: bool = True) -> Table:
    """The table of actions with the error after each; errors below `threshold_m` are marked."""
    table = Table(title=escape(title) or None, title_justify="left", title_style="bold")
    if not framed:
        table.box, table.padding, table.collapse_padding = None, (0, 1, 0, 0), True
    columns = [one for one in ACTION_COLUMNS if one.terminal and (one.of_all or any(map(one.has, rows)))]
    for one in columns:
        heading = (one.terminal if framed else one.narrow or one.terminal).format(millimetres(threshold_m))
        table.add_column(heading, justify="left" if one.is_text else "right", min_width=one.least_width)
    for row in rows:
        table.add_row(*(Text(one.text(row), style=_TONES[one.tone(row, threshold_m)]) for one in columns))
    return table


_TONES = {Tone.NONE: "", Tone.GOOD: "green", Tone.BAD: "red"}


def _progress(status: FlowStatus, candidates: Candidates | None) -> Text:
    text = Text.assemble(("▸ ", "cyan"), (status.step.replace("_", " "), "bold cyan"))
    if status.rmse_m is not None:
        text.append(f"   last error {millimetres(status.rmse_m)}")
    if status.text:
        text.append(f"   {status.text}", style="dim")
    if candidates is not None:
        text.append(f"   {candidates.rollouts} of {candidates.budget} rollouts", style="dim")
        if candidates.best:
            best = candidates.best[0]
            text.append(f", best: {best.kind} at node {best.node}, score {millimetres(best.score_m)}", style="dim")
    return text


def _plain(row: ActionResult) -> str:
    done = f"{row.kind}, node {row.grasp_node} {grip_text(row)}"
    return f"action {row.action}: {done}, RMSE {millimetres(row.rmse_m)}, {row.duration_s:.1f} s"


def missing_files(folder: Path, unwritten: Mapping[str, str], again: str) -> str:
    """One sentence on unwritten files: their names, the cause, the kept files, and what to do."""
    by_reason: defaultdict[str, list[str]] = defaultdict(list)
    for name, why in unwritten.items():
        by_reason[why].append(name)
    missing = "; ".join(f"{', '.join(names)} ({why})" for why, names in by_reason.items())
    try:
        kept = sorted(path.name for path in folder.iterdir() if path.is_file() and path.name not in unwritten)
    except OSError:
        kept = []
    kept = [name for name in kept if not name.startswith((".", "processes.json"))]
    repeat = f"repeat the run: {again}" if again else "start the program of the run again"
    return (
        f"The run has ended, but files are missing or incomplete: {missing}; kept in {folder}: "
        f"{', '.join(kept) or 'nothing'}; check that disk, then {repeat}"
    )
