"""A recorded run on the viewer's page."""

import asyncio
from dataclasses import replace
from pathlib import Path

from dlokit.system.replay import WATCHED_PARTS, recorded_config, show

REFERENCE = Path(__file__).parents[2] / "replay" / "references" / "wire.mcap"
LIMIT_S = 60.0  # it takes one


def test_a_recording_is_played_to_its_end_on_a_page_that_stays() -> None:
    config = recorded_config(REFERENCE, WATCHED_PARTS)
    config = replace(config, viewer=replace(config.viewer, port=0))
    said: list[str] = []

    async def main() -> None:
        ended = asyncio.Event()

        def say(text: str) -> None:
            said.append(text)
            if "has ended" in text:
                ended.set()

        showing = asyncio.create_task(show(REFERENCE, config, 1e6, say))
        async with asyncio.timeout(LIMIT_S):
            await ended.wait()
        assert not showing.done()
        showing.cancel()
        await asyncio.wait({showing})

    asyncio.run(main())
    assert said[0].startswith("viewer: http://127.0.0.1:")
    assert len(said) == 2
