"""`dlokit.shape`, `dlokit.open_run` and what works on a run: one run in lockstep, used as a script would."""

import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from made_fixtures import FURNISHED
from made_states import ARM_AT_REST

import dlokit
from dlokit.app.library.shape import outside_any_loop
from dlokit.app.shape.terminal import missing_files
from dlokit.communication import topics
from dlokit.description.installation import Installation
from dlokit.geometry import rmse_m
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.recorder import Recorder
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.types.dlo import DloState, Topology
from dlokit.types.feasibility import Standing

GOAL = np.column_stack([np.full(20, 0.52), np.linspace(0.24, -0.24, 20)])
"""Nearly the start: two looks and a judgement, and no action."""
SHORT = {
    "task.max_actions": 1,
    "task.threshold_m": 0.03,
    "task.check_camera": False,
    "cell.settle_s": 0.5,
    "fit_length": True,
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> dlokit.Run:
    return dlokit.shape("I", GOAL, settings=SHORT, out=tmp_path_factory.mktemp("run"), progress=False)


def test_a_run_says_how_it_ended_and_leaves_its_files(run: dlokit.Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.converged
    assert run.actions == run.result.history
    assert run.nodes_world is not None
    assert rmse_m(run.nodes_world, run.goal_nodes_world) < 0.03
    assert run.picture_before is not None
    assert run.picture_before.ndim == 3
    assert run.report.is_file()
    assert (run.folder / "config.toml").is_file()
    assert "converged" in repr(run)
    assert capsys.readouterr().out == ""  # progress=False


def test_a_recording_gives_arrays_over_time(run: dlokit.Run) -> None:
    recording = dlokit.open_run(run)
    state, robot, clouds = recording.state, recording.robot, recording.clouds
    assert state.nodes_world.shape == (len(state.stamp_ns), 31, 3)
    assert np.all(np.diff(state.stamp_ns) >= 0)
    assert recording.targets.visible.shape == (len(recording.targets.stamp_ns), 31)
    assert robot.q_rad.shape == (len(robot.stamp_ns), 7)
    np.testing.assert_allclose(np.linalg.norm(robot.tool_wxyz, axis=1), 1.0, atol=1e-6)
    assert len(clouds.points_world) == len(clouds.stamp_ns) > 0
    assert recording.pictures.left.shape == recording.pictures.right.shape
    assert recording.goal is not None
    assert recording.result == run.result
    assert sum(1 for _ in recording) == sum(recording.topics.values())
    last = recording.messages("model/state")[-1].message
    assert isinstance(last, DloState)
    np.testing.assert_array_equal(state.nodes_world[-1], last.nodes_world)


def test_the_robot_of_a_recording_is_the_first_arm_although_the_second_was_recorded_before_it(tmp_path: Path) -> None:
    near, far = (msgspec.structs.replace(ARM_AT_REST, robot=name) for name in ("near", "far"))
    with Recorder(tmp_path / FILE_NAME, lambda: 0, {}, waits=True) as recorder:
        recorder.put(topics.ROBOT_STATE.at("second"), far)
        recorder.put(topics.ROBOT_STATE, near)
    recording = dlokit.open_run(tmp_path)
    assert recording.robot is recording.robots["near"]
    assert set(recording.robots) == {"near", "far"}


def test_plots_are_drawn_and_saved(run: dlokit.Run, tmp_path: Path) -> None:
    assert run.plot(tmp_path / "run.png").axes
    assert len(dlokit.open_run(run).plot(tmp_path / "recording.png").axes) == 2
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_plots_show_the_fixtures_of_the_run(run: dlokit.Run, tmp_path: Path) -> None:
    furnished = replace(run, record=replace(run.record, fixtures=FURNISHED.fixtures))
    assert [text.get_text() for text in furnished.plot().axes[0].texts] == ["A", "lid"]
    config = replace(RunConfig(), installation=Installation(fixtures=FURNISHED.fixtures))
    metadata = {"configuration": {"config.toml": to_toml(config)}}
    topology = Topology(edges=np.zeros((0, 2), dtype=np.int64), rest_lengths_m=np.zeros(0))
    with Recorder(tmp_path / FILE_NAME, lambda: 0, metadata, waits=True) as recorder:
        recorder.put(topics.STATE, DloState(stamp_ns=1, nodes_world=np.eye(3), topology=topology))
    recording = dlokit.open_run(tmp_path)
    assert recording.fixtures == FURNISHED.fixtures
    assert [text.get_text() for text in recording.plot().axes[0].texts] == ["A", "lid"]


def test_a_recording_without_settings_has_no_fixtures(tmp_path: Path) -> None:
    with Recorder(tmp_path / FILE_NAME, lambda: 0, {}, waits=True) as recorder:
        recorder.put(topics.ROBOT_STATE, ARM_AT_REST)
    assert dlokit.open_run(tmp_path).fixtures == ()


@pytest.mark.parametrize("name", ["nowhere", "empty"])
def test_a_folder_without_a_recording_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(dlokit.InputError, match=f"{name}.*give the folder of a run"):
        dlokit.open_run(tmp_path / name)


def test_an_unknown_topic_is_refused_with_those_there_are(run: dlokit.Run) -> None:
    with pytest.raises(dlokit.InputError, match=r"model/stat'.*model/state"):
        dlokit.open_run(run).messages("model/stat")


def test_the_dlo_is_identified_from_a_run_and_the_figures_are_settings_of_the_next(run: dlokit.Run) -> None:
    found = dlokit.identify([run])
    assert found.size is not None
    assert abs(found.belief.length_m.value - 0.5) < 0.01
    verdict = dlokit.judge(GOAL, settings={"fit_length": True, **found.settings})
    assert verdict.standing is Standing.HOLDS


def test_a_goal_with_tight_bends_does_not_hold() -> None:
    t = np.linspace(0.0, 1.0, 60)
    zigzag = np.column_stack([0.52 + 0.03 * np.sin(20.0 * t), 0.4 * t - 0.2])
    verdict = dlokit.judge(zigzag, settings={"fit_length": True})
    assert verdict.standing is not Standing.HOLDS
    assert "springs back" in verdict.text


def test_everything_works_inside_a_running_event_loop() -> None:
    async def notebook() -> Standing:
        return dlokit.judge("S").standing

    assert asyncio.run(notebook()) is Standing.HOLDS


def test_ctrl_c_inside_a_running_loop_cancels_the_call_and_waits_for_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    cancelled = threading.Event()

    def function() -> str:
        asyncio.run(asyncio.sleep(0.0))  # no loop runs in this thread
        if not cancelled.wait(30.0):
            raise AssertionError("it was not cancelled")
        return "ended"

    async def notebook() -> str:
        from concurrent.futures import Future

        result, interrupts = Future[str].result, [KeyboardInterrupt]

        def interrupted(self: "Future[str]", timeout: float | None = None) -> str:
            if interrupts:
                raise interrupts.pop()
            return result(self, timeout)

        monkeypatch.setattr(Future, "result", interrupted)
        return outside_any_loop(function, cancelled.set)

    assert asyncio.run(notebook()) == "ended"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"goal": "Q"}, "Q"),
        ({"goal": [[0.5, 0.0, 0.0]]}, "goal.npy"),
        ({"planner": "best"}, "planner 'best'.*rollout"),
        ({"dlo": "spaghetti"}, "spaghetti.*soft_rope"),
        ({"settings": {"task.treshold_m": 0.1}}, "treshold_m"),
        ({"settings": {"tusk.threshold_m": 0.1}}, "tusk"),
        ({"settings": {"task.threshold_m": "small"}}, "threshold_m"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_bad_arguments_are_refused_before_anything_starts(
    arguments: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(dlokit.InputError, match=message):
        dlokit.shape(**arguments, out=tmp_path / "run")  # pyright: ignore[reportArgumentType]
    assert not (tmp_path / "run").exists()


class Interrupting:
    """A planner during whose first decision a person presses Ctrl-C."""

    def propose(self, shape: Any, goal: Any, marks: Any, tools: Any) -> Iterator[Any]:
        os.kill(os.getpid(), signal.SIGINT)
        for node in range(len(shape.nodes_world)):
            action = tools.pick_and_place(shape, goal, node)
            if node not in marks.invalid_nodes and action is not None:
                yield action


class Unasked:
    """A planner of a run that needs no action."""

    def propose(self, shape: Any, goal: Any, marks: Any, tools: Any) -> Iterator[Any]:
        raise AssertionError


def test_a_report_has_the_command_that_repeats_the_run_unless_only_its_program_can(
    run: dlokit.Run, tmp_path: Path
) -> None:
    command = "dlokit shape --config"
    assert command in run.report.read_text()
    own = dlokit.shape("I", GOAL, planner=Unasked(), settings=SHORT, out=tmp_path / "own", progress=False)
    assert command not in own.report.read_text()
    assert "start that program again" in own.report.read_text()
    assert missing_files(own.folder, {"truth.npz": "full"}, "").endswith("then start the program of the run again")


def test_ctrl_c_in_a_notebook_ends_the_run_as_cancelled(tmp_path: Path) -> None:
    soon = {"task.check_camera": False, "cell.settle_s": 0.5}

    async def notebook() -> dlokit.Run:
        return dlokit.shape("random", "S", planner=Interrupting(), settings=soon, out=tmp_path / "run", progress=False)

    loop = asyncio.new_event_loop()  # without asyncio.run's own handler, as in a notebook
    try:
        run = loop.run_until_complete(notebook())
    finally:
        loop.close()
    assert run.outcome.value == "cancelled"
    assert run.report.is_file()
