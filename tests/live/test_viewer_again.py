"""A restarted viewer: open pages reconnect, because its address is the same, key and port."""

import asyncio
import os
import signal
from dataclasses import replace
from pathlib import Path

from dlokit.communication import topics
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.config import RunConfig
from dlokit.system.live import live_system, namespace_of
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import VIEWER, ProcessRow, TimeBase
from dlokit.system.toml_config import to_toml

WAIT_S = 120.0  # a viewer starts within 2 s, or longer on a loaded machine
OWN = ProcessRow(name="main", components=(), time_base=TimeBase.MACHINE)


def test_a_restarted_viewer_keeps_its_address_and_another_run_has_another_one(tmp_path: Path) -> None:
    def launch() -> Launch:
        return Launch(namespace=namespace_of(tmp_path), config_file=tmp_path / "config.toml", run_dir=tmp_path)

    async def addresses() -> list[str]:
        async with live_system((OWN, replace(VIEWER, time_base=TimeBase.MACHINE)), launch()) as system:
            pages = aiter(system.transport.stream(topics.VIEWER_PAGE, with_last=True))
            first = await anext(pages)
            os.kill(system.supervisor.pids["viewer"], signal.SIGKILL)
            return [page.url for page in (first, await anext(pages))]

    async def both() -> tuple[list[str], list[str]]:
        async with asyncio.timeout(WAIT_S):
            return await addresses(), await addresses()

    (tmp_path / "config.toml").write_text(to_toml(RunConfig(viewer=ViewerConfig(port=0))), encoding="utf-8")
    one, other = asyncio.run(both())
    assert one[0] == one[1] != other[0] == other[1]
