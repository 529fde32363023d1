"""What differs between two runs: their settings and versions, beside their results. For `dlokit info RUN RUN`."""

from dataclasses import dataclass, fields
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from dlokit.app.shape.outcome_text import NONE, millimetres, seconds, when_true
from dlokit.errors import InputError
from dlokit.recording.summary import RecordingSummary
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.results.parts_of_run import changed_settings, setting_text
from dlokit.system.results.run_result import FILE_NAME, RunResult, read_result

RUN_PARTS = tuple(part.name for part in fields(RunConfig))
"""All parts of a configuration."""


@dataclass(frozen=True, kw_only=True)
class ComparedRun:
    """One of two runs that are compared."""

    path: Path
    """Its recording."""
    summary: RecordingSummary

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.path.absolute().parent.name

    def result(self) -> RunResult | None:
        """The result beside the recording; None where there is none. Raises `InputError` when it is invalid."""
        folder = self.path.parent
        return read_result(folder) if (folder / FILE_NAME).exists() else None

    def config(self) -> RunConfig | None:
        """The recorded configuration; None where this version cannot read it."""
        try:
            return recorded_config(self.path, RUN_PARTS)
        except InputError:
            return None


def differences(first: ComparedRun, second: ComparedRun) -> list[Table | str]:
    """The tables of two runs: results side by side, then the settings and the versions that differ, if any do."""
    one, another = _results(first), _results(second)
    results = [(name, one.get(name, NONE), another.get(name, NONE)) for name in max(one, another, key=len)]
    mine, other = (run.summary.metadata.get("versions", {}) for run in (first, second))
    differing = [
        (name, mine.get(name, NONE), other.get(name, NONE))
        for name in dict.fromkeys((*mine, *other))
        if mine.get(name) != other.get(name)
    ]
    return [
        _table("result", first, second, results),
        _table("settings that differ", first, second, _settings(first.config(), second.config())),
        _table("versions that differ", first, second, differing),
    ]


def _results(run: ComparedRun) -> dict[str, str]:
    """The figures of a result by their names; of a recording without a result, those that it has itself."""
    result, last = run.result(), run.summary.last_step
    if result is None:
        ended = None if last is None else last.outcome
        return {
            "outcome": "not ended" if ended is None else ended.value,
            "actions": NONE if last is None else str(last.actions),
            "time on the run's clock": seconds(run.summary.duration_s),
        }
    which = f" (task {result.task} of {len(result.tasks)})" if result.tasks else ""
    return {
        "outcome": f"{result.outcome.value}{which}",
        "RMSE, estimated": millimetres(result.rmse_m),
        "RMSE, true": millimetres(result.true_rmse_m) if when_true(result) else NONE,
        "actions": str(result.actions),
        "kinds of action": ", ".join(row.kind for row in result.history) or NONE,
        "time on the run's clock": seconds(result.sim_time_s),
        "wall time": seconds(result.wall_time_s),
        "planning time": seconds(result.planning_time_s),
    }


def _settings(first: RunConfig | None, second: RunConfig | None) -> list[tuple[str, str, str]]:
    """Path and both values of each setting that differs. Of different strategies, what differs from their defaults."""
    if first is None or second is None:
        unread = "not known to this version"
        return [("configuration", unread if first is None else "", unread if second is None else "")]
    paths = dict.fromkeys((*changed_settings(first), *changed_settings(second)))
    found = ((path, setting_text(first, path) or NONE, setting_text(second, path) or NONE) for path in paths)
    return [(path, mine, other) for path, mine, other in found if mine != other]


def _table(title: str, first: ComparedRun, second: ComparedRun, rows: list[tuple[str, str, str]]) -> Table | str:
    if not rows:
        return f"{title}: none"
    table = Table(title=title, title_justify="left")
    names = (first.name, second.name) if first.name != second.name else (str(first.path), str(second.path))
    for heading in ("", *map(escape, names)):
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table
