"""`Run`: the result of `dlokit.shape`."""

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from dlokit.app.library.plots import draw_errors, draw_shapes, new_figure, saved
from dlokit.app.library.recording import Recording, open_run
from dlokit.system.results.run_result import ActionResult, RunRecord, RunResult
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.flow import RunOutcome


@dataclass(frozen=True, eq=False)
class Run:
    """A task that has ended: its outcome, its shapes and the files that it wrote."""

    record: RunRecord
    folder: Path
    """Folder with result.json, config.toml, recording.mcap and report.html."""
    report: Path
    """The report, one HTML page."""

    @property
    def result(self) -> RunResult:
        """The content of `result.json`."""
        return self.record.result

    @property
    def outcome(self) -> RunOutcome:
        """Outcome of the task, e.g. `RunOutcome.CONVERGED`; `outcome.value` is its name as text."""
        return self.result.outcome

    @property
    def converged(self) -> bool:
        """Whether the DLO reached the goal within the threshold."""
        return self.outcome is RunOutcome.CONVERGED

    @property
    def actions(self) -> tuple[ActionResult, ...]:
        """The actions, one per grasp-to-release, each with its kind, grasped node, errors [m] and times [s]."""
        return self.result.history

    @property
    def rmse_m(self) -> float | None:
        """The last estimate of the error to the goal [m]; None if the DLO was never seen."""
        return self.result.rmse_m

    @property
    def true_rmse_m(self) -> float | None:
        """The true error in the cell 2 s after the last release [m]; None without a simulated cell."""
        return self.result.true_rmse_m

    @property
    def start_nodes_world(self) -> Float64Array | None:
        """Nodes (M, 3) [m] at the first look; None if the DLO was never seen."""
        return self.record.start_nodes_world

    @property
    def goal_nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m] of the goal."""
        return self.record.goal_nodes_world

    @property
    def nodes_world(self) -> Float64Array | None:
        """Estimated nodes (M, 3) [m] at the end; None if the DLO was never seen."""
        actions = self.record.actions
        return actions[-1].nodes_world if actions else self.record.start_nodes_world

    @property
    def picture_before(self) -> UInt8Array | None:
        """The camera's first picture (height, width, 3), RGB; None when none was taken."""
        return self.record.image_before

    @property
    def picture_after(self) -> UInt8Array | None:
        """The camera's last picture (height, width, 3), RGB; None when none was taken."""
        return self.record.image_after

    def plot(self, path: Path | str | None = None) -> Figure:
        """Draw start, goal, the shape after each action, and the error; save the figure where a `path` is given."""
        figure, (top, curve) = new_figure(columns=2)
        draw_shapes(
            top,
            goal=self.goal_nodes_world,
            start=self.start_nodes_world,
            shapes=[action.nodes_world for action in self.record.actions],
            fixtures=self.record.fixtures,
        )
        draw_errors(curve, self.result)
        figure.suptitle(self.record.name)
        return saved(figure, path)

    def recording(self) -> Recording:
        """The recording of the run. Raises `InputError` if none was made (``settings={"record": False}``)."""
        return open_run(self.folder)

    def __fspath__(self) -> str:
        """The folder, so that a run can be passed wherever a run's path is expected."""
        return str(self.folder)

    def __repr__(self) -> str:
        error = "" if self.rmse_m is None else f", RMSE {self.rmse_m * 1000:.1f} mm"
        return f"<Run {self.record.name}: {self.outcome.value}, {len(self.actions)} actions{error}, {self.folder}>"
