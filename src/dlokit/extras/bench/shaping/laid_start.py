"""The start of a case without a simulated cell: a separate task brings the DLO there, or confirms that it is there.

A cell can place its DLO; on a real table the arm does so, with the configured strategies for every method, so that all
methods begin at the same start to within the task's threshold. If the DLO is already there, from the previous case or
placed by hand, the task looks at it and does not touch it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dlokit.decision.records import GoalRequest
from dlokit.errors import DlokitError
from dlokit.evaluation.judged_run import judged_run
from dlokit.extras.bench.shaping.cases import ShapingCase
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.shaping import Watcher
from dlokit.types.flow import RunOutcome

FOLDER = "start"
"""Folder of the task that brings the DLO to the start, in the folder of the case."""
START_FILE = "goal.npy"
"""File with the start of the case, which is the goal of this task."""


class StartNotLaid(DlokitError):
    """The DLO is not at the start of the case."""


def lay_start(case: ShapingCase, config: RunConfig, folder: Path, watch: Watcher) -> RunOutcome:
    """Bring the DLO to the start of a case; `config` belongs to the sweep, `folder` to the case.

    `watch` confirms that a real arm may start. Returns ``converged``, or ``cancelled`` after Ctrl-C or without that
    confirmation. Raises `StartNotLaid` if the task ended otherwise.
    """
    config = case.experiment.configured(config)
    believed = replace(config.cell.dlo, length_m=config.model.length_m, radius_m=config.model.radius_m)
    nodes = case.experiment.start_world(believed, case.run_seed)
    here = folder / FOLDER
    here.mkdir()
    path = (here / START_FILE).absolute()
    np.save(path, nodes)
    # A start has interchangeable ends: the system orders the nodes of each task by its first look.
    config = replace(config, goal=str(path), seed=case.run_seed, headless=True, ends_interchangeable=True)
    request = GoalRequest(nodes_world=nodes, name=f"start {case.experiment.start}", ends_interchangeable=True)
    job = ShapeJob(name=f"start of {case.experiment.name}", start_nodes_world=HIDDEN_START, request=request)
    result = judged_run(config, job, here, watch).result
    if result.outcome in (RunOutcome.CONVERGED, RunOutcome.CANCELLED):
        return result.outcome
    at = (
        "the DLO was not seen" if result.rmse_m is None else f"the DLO lies {result.rmse_m * 1e3:.1f} mm from it (RMSE)"
    )
    raise StartNotLaid(
        f"the arm did not bring the DLO to the start {case.experiment.start!r}: {result.outcome.value}, {at}. Lay it "
        f"along {path} by hand, and repeat the command with the same --out"
    )
