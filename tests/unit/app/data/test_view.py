"""`dlokit view`: its settings and what it refuses."""

from pathlib import Path

import pytest

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.writer import RecordingWriter
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system import watching
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.types.system import ClockTick


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run with only the clock recorded, whose page was open to the network."""
    config = RunConfig(viewer=ViewerConfig(host="0.0.0.0", port=8123))
    writer = RecordingWriter(tmp_path / FILE_NAME, {"configuration": {"config.toml": to_toml(config)}})
    writer.add(topics.CLOCK, 0, ClockTick(stamp_ns=0, seq=1))
    writer.close()
    return tmp_path


def test_the_page_is_served_on_this_machine_alone(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[ViewerConfig, float]] = []

    async def show(path: Path, config: RunConfig, speed: float, *_: object) -> None:
        assert path == run / FILE_NAME
        shown.append((config.viewer, speed))

    monkeypatch.setattr(watching, "show", show)
    assert execute(["view", str(run)]) == 0
    assert execute(["view", str(run / FILE_NAME), "--port", "9000", "--speed", "2"]) == 0
    assert shown == [(ViewerConfig(port=8123), 1.0), (ViewerConfig(port=9000), 2.0)]


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf"])
def test_a_speed_that_is_none_is_refused_with_a_remedy(run: Path, speed: str) -> None:
    with pytest.raises(InputError, match=r"it must be greater than 0, e\.g\. 2 for double speed"):
        execute(["view", str(run), f"--speed={speed}"])


def test_a_recording_without_anything_to_show_is_refused_with_a_remedy(run: Path) -> None:
    with pytest.raises(InputError, match="contains nothing to show; give the recording of a run of dlokit shape"):
        execute(["view", str(run), "--port", "0"])
