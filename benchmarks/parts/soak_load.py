"""The load of a soak, in a process of its own: pages that are opened and closed, and a peer that floods the bus.

Arguments: the folder of the run, and the address of its page. When its standard input is closed it prints what it
did, as JSON, and then closes its browser and its sessions.
"""

import asyncio
import json
import os
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path

from playwright.async_api import Error, ViewportSize, async_playwright

from dlokit.communication import topics
from dlokit.communication.wire.envelope import pack_envelope
from dlokit.communication.wire.schema import fingerprint
from dlokit.communication.zenoh.session import open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.skills.robot import api as robot
from dlokit.system.processes.running import RunningSystem, the_running_system
from parts.faults.forging_peer import joined

CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = ["--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]
VIEWPORT_PX: ViewportSize = {"width": 400, "height": 300}
"""Small, because Chromium renders in software at high priority: on two slow cores an arm lost its lease 63 times an
hour beside pages of 1280 by 720, and 21 times beside these."""
LOOKED_AT_S = 5.0
BETWEEN_PAGES_S = 25.0
MESSAGE_BYTES = 10_000
MESSAGES_EVERY_S = 0.005
CALLS_EVERY_S = 0.1
PEERS_EVERY_S = 0.5
"""Often: the first thousand peers cost memory once, which is over when the slope begins."""


async def pages(address: str, done: Counter[str]) -> None:
    """Open the page, look at it and close it, again and again; every fourth visit by a browser of its own."""
    async with async_playwright() as playwright:
        while True:
            browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
            for _ in range(4):
                page = await browser.new_page(viewport=VIEWPORT_PX)
                try:
                    await page.goto(address)
                    await page.locator("canvas").first.wait_for()
                    await asyncio.sleep(LOOKED_AT_S)
                    done["pages"] += 1
                except Error as error:  # a busy machine may take longer than the browser waits
                    done[f"pages that failed: {type(error).__name__}"] += 1
                await page.close()
                await asyncio.sleep(BETWEEN_PAGES_S)
            await browser.close()


async def garbage(system: RunningSystem, done: Counter[str]) -> None:
    """Publish messages with a valid envelope that cannot be decoded."""
    topic = topics.GOAL_FRAMES
    session = open_session(system.bus)
    publisher = session.declare_publisher(f"topic/{topic.name}")
    envelope = pack_envelope(fingerprint(topic.type))
    try:
        while True:
            publisher.put(os.urandom(MESSAGE_BYTES), attachment=envelope)
            done["messages"] += 1
            await asyncio.sleep(MESSAGES_EVERY_S)
    finally:
        session.close()


async def calls(system: RunningSystem, done: Counter[str]) -> None:
    """Call a skill that the robot rejects: another's lease."""
    transport = ZenohTransport(system.bus)
    try:
        while True:
            outcome = await transport.call(robot.RENEW_LEASE, "another", 1.0)
            done[f"calls {type(outcome).__name__}"] += 1
            await asyncio.sleep(CALLS_EVERY_S)
    finally:
        await transport.close()


async def peers(system: RunningSystem, done: Counter[str]) -> None:
    """Join with the key, read and leave again; and try to join without it."""
    while True:
        transport = ZenohTransport(system.bus)
        transport.latest(topics.STATE)
        await asyncio.sleep(1.0)
        await transport.close()
        done["peers"] += 1
        if await asyncio.to_thread(joined, system.namespace, system.endpoint, None):
            done["peers without the key"] += 1
        await asyncio.sleep(PEERS_EVERY_S)


async def main(folder: Path, page: str) -> None:
    """Run the load until the standard input is closed."""
    system, done = the_running_system(folder), Counter[str]()
    work = (garbage(system, done), calls(system, done), peers(system, done), pages(page, done))
    running = [asyncio.create_task(each) for each in work]
    over = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    ended, _ = await asyncio.wait({over, *running}, return_when=asyncio.FIRST_COMPLETED)
    for task in ended - {over}:
        done[f"ended by {task.exception()!r}"] += 1
    print(json.dumps(done), flush=True)  # before closing, which takes long where a browser is just starting
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(main(Path(sys.argv[1]), sys.argv[2]))
