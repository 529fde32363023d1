"""Cameras are chosen by name: in files, on the command line, and from other packages."""

from pathlib import Path

import pytest
from installed_packages import install
from rich.console import Console

from dlokit.app.commands import parse
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.strategies import StrategyKind
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import ConfigError
from dlokit.extras.bench.commands.shaping import ShapingArgs, compare
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.simulated import SimulatedD435Config, SimulatedStereoConfig
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.skills.perception.component import PerceptionComponent
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.configuration.toml_config import from_toml, to_toml
from dlokit.system.results.run_folder import HIDDEN_START


@pytest.mark.parametrize("kind", CAMERAS.installed().values())
def test_a_configuration_file_names_the_camera(kind: type):
    run = RunConfig(camera=kind())
    assert f'kind = "{kind.name}"' in to_toml(run)
    assert from_toml(to_toml(run), RunConfig, "file") == run


def test_the_command_line_names_the_camera_and_shows_its_settings(capsys: pytest.CaptureFixture[str]):
    assert parse(["shape"]).run.camera == SimulatedStereoConfig()
    assert parse(["shape", "--camera", "simulated-d435"]).run.camera == SimulatedD435Config()
    given = parse(["shape", "--camera", "recorded", "--camera.path", "here", "--camera.repeat"])
    assert given.run.camera == RecordedCameraConfig(path="here", repeat=True)
    with pytest.raises(SystemExit):
        parse(["shape", "--camera", "recorded", "--help", "camera"])
    assert "--camera.path" in capsys.readouterr().out
    with pytest.raises(
        ConfigError, match=r"choose one of simulated, simulated-d435, recorded, genicam, realsense, ros2, scenescan"
    ):
        parse(["shape", "--camera", "webcam"])


def test_a_run_needs_a_camera_that_sees_the_arm_move():
    run = RunConfig(camera=RecordedCameraConfig(path="here"), headless=True)
    with pytest.raises(ConfigError, match=r"simulated or simulated-d435.*dlokit track --camera recorded"):
        check_before_start(run)
    with pytest.raises(ConfigError, match="does not see the simulated cell"):
        compare(ShapingArgs(camera="recorded"), Console(quiet=True))


def test_the_builder_of_perception_opens_what_the_configuration_says(tmp_path: Path):
    wiring = Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=tmp_path, start_nodes_world=HIDDEN_START)
    built = build_component("perception", RunConfig(camera=SimulatedD435Config()), wiring)
    assert isinstance(built, PerceptionComponent)
    with pytest.raises(ConfigError, match=str(tmp_path)):
        build_component("perception", RunConfig(camera=RecordedCameraConfig(path=str(tmp_path))), wiring)


THEIRS = """
from dataclasses import dataclass
from typing import ClassVar

@dataclass(frozen=True)
class WebcamConfig:
    name: ClassVar[str] = "webcam"
    sees_cell: ClassVar[bool] = False
    device: int = 0

    def build(self, caller):
        raise NotImplementedError
"""


def test_other_packages_add_cameras_by_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(tmp_path)
    install(tmp_path, "webcams", "dlokit.cameras", {"webcam": "of_webcams:WebcamConfig"}, {"of_webcams": THEIRS})
    # One that has not looked for packages before.
    cameras = StrategyKind(CAMERAS.purpose, CAMERAS.entry_points, CAMERAS.builtin)
    assert list(cameras.installed()) == [
        "simulated",
        "simulated-d435",
        "recorded",
        "genicam",
        "realsense",
        "ros2",
        "scenescan",
        "webcam",
    ]
    assert cameras.named("webcam", "--camera")().sees_cell is False
