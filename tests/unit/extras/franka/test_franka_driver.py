"""The driver of a Franka arm waits for an answer of its processes for a limited time."""

import asyncio

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.extras.franka.driver import becomes


@pytest.mark.parametrize(
    ("after_s", "so", "waited_s"), [(0.0, True, 0.0), (1.0, True, 1.0), (2.5, False, 2.0), (1e9, False, 2.0)]
)
def test_a_wait_ends_when_it_is_so_or_with_its_time(after_s: float, so: bool, waited_s: float) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        assert await becomes(lambda: loop.time() - began_s >= after_s, 2.0) is so
        assert loop.time() - began_s == pytest.approx(waited_s, abs=0.01)

    virtual_time.run(main())
