"""`dlokit shape` with a disturbed bus of all its processes: `disturbed_shape.py CONFIG FOLDER FILE`."""

import sys
from functools import partial
from pathlib import Path

from dlokit.errors import EXIT_OTHERWISE
from dlokit.evaluation.judged_run import judged_run
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.job import job_from_config
from dlokit.system.live import Starting, run_live
from dlokit.system.results.run_folder import claim_run_folder
from dlokit.system.shaping import Watcher
from dlokit.types.flow import RunOutcome

sys.path.insert(0, str(Path(__file__).parents[2]))  # as for the study

from parts.faults.disturbance import disturbed_by, disturbed_process

if __name__ == "__main__":
    config, folder, file = read_toml(Path(sys.argv[1]), RunConfig), Path(sys.argv[2]), Path(sys.argv[3])
    starting = Starting(command=disturbed_process(file), open_session=disturbed_by(file))
    runner = partial(run_live, starting=starting)
    result = judged_run(config, job_from_config(config), claim_run_folder(folder), Watcher(), runner).result
    print(result.outcome.value, result.reason or "")
    sys.exit(0 if result.outcome is RunOutcome.CONVERGED else EXIT_OTHERWISE)
