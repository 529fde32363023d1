"""The settings of the GenICam driver; tests/live has it take pictures."""

import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from genicam_cameras import OPTICS

from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.cameras import genicam
from dlokit.extras.cameras.genicam import GenicamConfig, GenicamPair
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, write_calibration
from dlokit.geometry import pose


def test_a_pair_needs_two_names_and_its_optics(tmp_path: Path):
    file = tmp_path / "calibration.toml"

    def built(left: str = "a", right: str = "b", calibration: str = str(file), exposure_ms: float = 10.0) -> Any:
        config = GenicamConfig(left=left, right=right, calibration=calibration, exposure_ms=exposure_ms)
        return config.build(MemoryTransport())

    with pytest.raises(ConfigError, match=r"--camera\.left.*dlokit doctor"):
        built(right="a")
    with pytest.raises(ConfigError, match=r"--camera\.calibration.*dlokit calibrate stereo"):
        built(calibration="")
    write_calibration(file, msgspec.structs.replace(OPTICS, baseline_m=None))
    with pytest.raises(ConfigError, match="of a single camera"):
        built()
    write_calibration(file, OPTICS)
    with pytest.raises(ConfigError, match=r"--camera\.exposure-ms is 0"):
        built(exposure_ms=0.0)
    assert built().calibration.T_world_camera.position_m[2] == 1.2
    write_calibration(file, msgspec.structs.replace(OPTICS, T_world_camera=pose((0.0, 0.0, 0.0))))
    assert built().calibration.T_world_camera is OVER_THE_TABLE


def test_without_aravis_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "gi", None)
    monkeypatch.setattr(genicam, "_SYSTEM_PACKAGES", Path("/nowhere"))
    with pytest.raises(HardwareError, match=r"apt install gir1\.2-aravis-0\.8 python3-gi"):
        GenicamPair("a", "b", OPTICS).__enter__()
