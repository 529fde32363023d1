"""A live run in which the bus of all processes is disturbed: `disturbed_shape CONFIG FOLDER FILE`."""

import sys
from functools import partial
from pathlib import Path

from dlokit.decision.records import GoalRequest
from dlokit.description.shapes import CURVE_POINTS, builtin_shape
from dlokit.errors import EXIT_OTHERWISE
from dlokit.evaluation.judged_run import judged_run
from dlokit.system.config import RunConfig
from dlokit.system.live import Starting, run_live
from dlokit.system.results.run_folder import claim_run_folder
from dlokit.system.shaping import ShapeJob, Watcher
from dlokit.system.toml_config import read_toml
from dlokit.types.flow import RunOutcome

sys.path.insert(0, str(Path(__file__).parents[2]))  # as for the study

from parts.faults.disturbance import disturbed_by, disturbed_process


def main(config_file: Path, folder: Path, disturbance: Path) -> int:
    """Run the task; exit code as of `dlokit shape`."""
    config = read_toml(config_file, RunConfig)
    dlo, model = config.cell.dlo, config.model
    start = builtin_shape(config.start, dlo.length_m, CURVE_POINTS, radius_m=dlo.radius_m)
    goal = builtin_shape(config.goal, model.length_m, CURVE_POINTS, radius_m=model.radius_m)
    job = ShapeJob(
        name=f"{config.start} to {config.goal}",
        start_nodes_world=start,
        request=GoalRequest(nodes_world=goal, name=config.goal),
    )
    starting = Starting(
        command=disturbed_process(disturbance),
        open_session=disturbed_by(disturbance),
    )
    record = judged_run(config, job, claim_run_folder(folder), Watcher(), partial(run_live, starting=starting))
    print(record.result.outcome.value, record.result.reason or "")
    return 0 if record.result.outcome is RunOutcome.CONVERGED else EXIT_OTHERWISE


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])))
