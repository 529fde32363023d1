"""Entry point of a started process whose bus is disturbed; its first argument names the file that says how."""

import os
import sys
from pathlib import Path

from dlokit.bench.faults.disturbance import disturbed_by
from dlokit.system.child_runtime import run_child
from dlokit.system.process_main import build

if __name__ == "__main__":
    run_child(build, disturbed_by(Path(sys.argv[1]), os.getpid()))
