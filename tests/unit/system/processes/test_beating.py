"""A process that prepares its work sends heartbeats meanwhile, so that a long compilation is not taken for a hang."""

import asyncio
import os

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.system.processes.child import beating
from dlokit.system.processes.child_process import BEAT, BEAT_PERIOD_S


@pytest.mark.parametrize("fails", [False, True])
def test_it_beats_during_its_preparation_alone(fails: bool) -> None:
    async def prepare() -> None:
        await asyncio.sleep(10.25 * BEAT_PERIOD_S)
        if fails:
            raise ZeroDivisionError

    async def main(beat_fd: int) -> None:
        try:
            await beating(beat_fd, prepare())
        except ZeroDivisionError:
            assert fails
        await asyncio.sleep(60.0)

    heard, beat_fd = os.pipe()
    try:
        virtual_time.run(main(beat_fd))
        assert os.read(heard, 1000) == 11 * BEAT  # the first at once; and it was not yet ready
    finally:
        os.close(heard)
        os.close(beat_fd)
