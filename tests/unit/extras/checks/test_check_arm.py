from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import ARM_NAMES, arm_model
from dlokit.errors import CheckFailed
from dlokit.extras.checks.command import ArmCheckArgs, run
from dlokit.testing import check_arm


@pytest.mark.parametrize("name", ARM_NAMES)
def test_every_arm_that_is_shipped_passes(name: str):
    pytest.importorskip("airo_models", reason="the extra dlokit[arms] is not installed")
    report = check_arm(arm_model(name))
    assert report.reached > 0.9
    assert report.joints == len(arm_model(name).joints)


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        ({"home_q_rad": np.array([0.0, 0.6, 0.0, -1.9, 0.0, 2.5, 0.785])}, "view"),
        ({"home_q_rad": np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.9, 0.785])}, "home"),
        ({"gripper": replace(PANDA.gripper, tip_below_tcp_m=-0.01)}, "gripper"),
        ({"gripper": replace(PANDA.gripper, closed_half_width_m=17.5)}, "gripper"),
        ({"capsules": tuple(replace(each, radius_m=0.4 * each.radius_m) for each in PANDA.capsules)}, "capsules"),
        (
            {"limits": msgspec.structs.replace(PANDA.limits, jerk_rad_s3=np.full(7, -1.0))},
            "limits",
        ),
    ],
)
def test_a_fault_is_found_under_its_name(wrong: dict[str, object], check: str):
    with pytest.raises(CheckFailed, match=f"failed: .*{check}"):
        check_arm(replace(PANDA, **wrong))


def test_the_command_writes_a_report_of_an_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert run(ArmCheckArgs(arm="panda")) == 0
    path = Path(capsys.readouterr().out.rpartition("attach to a bug report: ")[2].strip())
    text = path.read_text()
    assert "passed 8 checks" in text
    assert "7 joints" in text
    assert "| inverse kinematics of a grasp | p50 " in text
