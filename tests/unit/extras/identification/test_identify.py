"""`dlokit identify` on a recording of two actions of a stiff rod."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.description.shapes import builtin_shape
from dlokit.errors import EXIT_OTHERWISE, InputError
from dlokit.motion.tool_track import tool_track
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.writer import RecordingWriter
from dlokit.rod.believed import topology
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import read_toml, to_toml
from dlokit.types.action import VelocityProfile
from dlokit.types.dlo import DloState
from dlokit.types.flow import FlowStatus
from dlokit.types.observation import GraspState
from dlokit.types.robot import RobotMode

RUN = RunConfig()
STIFF = 24.0
STEP_S = 0.005


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """A run in which node 7 was carried once."""
    model, pace = RUN.model, VelocityProfile()
    before = builtin_shape("I", model.length_m, model.nodes)
    grasp = np.array([*before[7, :2], 0.011, math.pi / 2])
    way = [(0.0, 0.0, 0.04, 0.0), (0.06, 0.02, 0.04, 0.6), (0.06, 0.02, 0.0, 0.6)]
    waypoints = np.stack([grasp, *(grasp + np.array(step) for step in way)])
    motion = Motion(node=7, waypoints=waypoints, velocity=pace)
    rod = PlanningRod(stiffness_factor=STIFF)
    after = simulate(model, before, (rod,), (motion,), STEP_S, rest_s=1.0).nodes_world[0, 0]
    track = tool_track(waypoints, pace.speed_m_s, pace.acceleration_m_s2, pace.jerk_m_s3, STEP_S)
    writer = RecordingWriter(tmp_path / FILE_NAME, {"run": {"name": "I to S"}})
    writer.add(topics.STATE, 0, DloState(stamp_ns=0, nodes_world=before, topology=topology(model)))
    writer.add(topics.FLOW, 1, FlowStatus(stamp_ns=1, flow="shape_dlo", step="choose_grasp"))
    writer.add(topics.GRIPPED, 2, GraspState(stamp_ns=2, robot="first", node=7))
    for number, place in enumerate(track[::4]):
        stamp_ns = 10 + round(number * 4 * STEP_S * 1e9)
        state = structs.replace(
            ARM_AT_REST,
            stamp_ns=stamp_ns,
            T_world_tcp=geometry.downward(place[:3], place[3]),
            finger_width_m=0.008,
            mode=RobotMode.MOVING,
            holding=True,
        )
        writer.add(topics.ROBOT_STATE, stamp_ns, state)
    end_ns = 10_000_000_000
    writer.add(topics.GRIPPED, end_ns, GraspState(stamp_ns=end_ns, robot="first", node=None))
    writer.add(topics.STATE, end_ns, DloState(stamp_ns=end_ns, nodes_world=after, topology=topology(model)))
    writer.add(topics.FLOW, end_ns, FlowStatus(stamp_ns=end_ns, flow="shape_dlo", step="has_error_changed"))
    writer.close()
    (tmp_path / "config.toml").write_text(to_toml(RUN))
    return tmp_path


def test_identify_prints_parameters_and_writes_them_to_a_configuration(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["identify", str(run_folder)]) == 0
    printed = capsys.readouterr().out
    assert "bending stiffness" in printed
    learnt = read_toml(run_folder / "identified.toml", RunConfig)
    found = learnt.model.bending_stiffness_n_m2 / learnt.model.friction
    true = STIFF * RUN.model.bending_stiffness_n_m2 / RUN.model.friction
    assert abs(math.log(found / true)) < 0.5
    assert replace(learnt, model=RUN.model) == RUN
    assert (run_folder / "identified.png").stat().st_size > 5000

    path = run_folder / FILE_NAME
    path.write_bytes(path.read_bytes()[:-9])  # all messages are there
    assert execute(["identify", str(run_folder)]) == EXIT_OTHERWISE
    assert "is incomplete, the estimate uses the rest of it" in capsys.readouterr().out


def test_a_run_without_actions_is_refused_by_name(tmp_path: Path) -> None:
    RecordingWriter(tmp_path / FILE_NAME, {}).close()
    (tmp_path / "config.toml").write_text(to_toml(RUN))
    with pytest.raises(InputError, match="no action"):
        execute(["identify", str(tmp_path)])
    with pytest.raises(InputError, match=r"config\.toml"):
        execute(["identify", str(tmp_path / "nowhere")])
