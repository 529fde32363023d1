"""Records a clock that ticks every 10 ms, and prints each tick, until it is killed."""

import sys
import time
from pathlib import Path

from dlokit.communication import topics
from dlokit.recording.recorder import Recorder
from dlokit.types.system import ClockTick


def tick_for_ever(path: Path) -> None:
    began_ns = time.monotonic_ns()
    with Recorder(path, lambda: time.monotonic_ns() - began_ns, {"run": {"name": "killed"}}, waits=False) as recorder:
        number = 0
        while True:
            number += 1
            stamp_ns = time.monotonic_ns() - began_ns
            recorder.put(topics.CLOCK, ClockTick(stamp_ns=stamp_ns, seq=number))
            print(stamp_ns, flush=True)
            time.sleep(0.01)


if __name__ == "__main__":
    tick_for_ever(Path(sys.argv[1]))
