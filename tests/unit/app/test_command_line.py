"""Bad input: one clear line, exit code 2, and nothing started."""

import io
import os
import signal
import sys
from collections.abc import Callable, Generator
from importlib.metadata import version
from pathlib import Path

import numpy as np
import psutil
import pytest

from dlokit.app.commands import execute, parse
from dlokit.app.shape import shape as shape_command
from dlokit.app.shape.shape import ShapeArgs
from dlokit.description.shapes import builtin_shape
from dlokit.errors import EXIT_BAD_INPUT, ConfigError, InputError
from dlokit.functional.cell.config import EVERY_FACTOR, ElasticRod, ElastoplasticChain
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_toml, to_toml

RUNTIMES = ("lockstep", "live")
LINE = np.column_stack([np.linspace(0.0, 0.5, 20), np.zeros(20)])  # (20, 2) [m] a rope's length of straight line


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """A working directory with shape files, in which no test may leave a new file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "header.csv").write_text("x,y\n")
    (tmp_path / "words.csv").write_text("0.4,0.0\nhere,there\n")
    (tmp_path / "point.csv").write_text("0.4,0.0\n")
    (tmp_path / "nan.csv").write_text("0.4,0.0\nnan,0.1\n0.5,0.2\n")
    (tmp_path / "short.csv").write_text("0.4,0.0\n0.5,0.0\n")
    (tmp_path / "table.txt").write_text("0.4,0.0\n0.5,0.0\n")
    (tmp_path / "notes.npy").write_text("no array")
    np.save(tmp_path / "four.npy", np.zeros((10, 4)))
    np.save(tmp_path / "off.npy", LINE + np.array([2.0, 0.0]))
    np.save(tmp_path / "far.npy", LINE[:, ::-1] + np.array([0.75, -0.15]))
    np.save(tmp_path / "many.npy", np.stack([LINE + np.array([0.3, 0.1]), LINE + np.array([0.3, 0.2])]))
    np.save(tmp_path / "zigzag.npy", _zigzag())
    (tmp_path / "unknown.toml").write_text("colour = 1\n")
    (tmp_path / "wrong.toml").write_text('seed = "one"\n')
    (tmp_path / "nonsense.toml").write_text("seed = = 1\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "result.json").write_text("{}")
    before = {path.name for path in tmp_path.iterdir()}
    yield tmp_path
    assert {path.name for path in tmp_path.iterdir()} == before


def _zigzag() -> np.ndarray:
    """A curve (K, 2) [m] of the rope's length with corners that no rope can form."""
    along = np.arange(26) * 0.01
    return np.column_stack([0.40 + along, 0.0173 * (np.arange(26) % 2)])


BAD = {
    "an unknown shape": (["--goal", "Z"], "no shape 'Z'"),
    "a shape in small letters": (["--goal", "s"], "did you mean 'S'"),
    "a file that is not there": (["--goal", "missing.csv"], "does not exist"),
    "a file of another kind": (["--goal", "table.txt"], "ends in '.txt'"),
    "an empty file": (["--goal", "empty.csv"], "is empty"),
    "a file of a header alone": (["--start", "header.csv"], "contains no numbers"),
    "words among numbers": (["--goal", "words.csv"], "line 2"),
    "a file that is no array": (["--goal", "notes.npy"], "is not an array"),
    "NaN": (["--goal", "nan.csv"], "NaN"),
    "one point": (["--start", "point.csv"], "1 point"),
    "four columns": (["--goal", "four.npy"], "(10, 4)"),
    "several shapes without an index": (["--goal", "many.npy"], "many.npy:0"),
    "an index out of range": (["--goal", "many.npy:99"], "'99'"),
    "another length": (["--goal", "short.csv"], "--fit-length"),
    "a goal off the table": (["--goal", "off.npy"], "outside the table"),
    "a start off the table": (["--start", "off.npy"], "outside the table"),
    "a configuration that is not there": (["--config", "missing.toml"], "missing.toml"),
    "a configuration with an unknown key": (["--config", "unknown.toml"], "unknown key colour"),
    "a configuration with a wrong type": (["--config", "wrong.toml"], "seed"),
    "a configuration that is no TOML": (["--config", "nonsense.toml"], "not TOML"),
    "a full folder": (["--out", "full"], "not empty"),
    "a file for a folder": (["--out", "nan.csv"], "is a file"),
    "no actions": (["--max-actions", "0"], "--max-actions is 0"),
    "fewer than no actions": (["--max-actions", "-1"], "--max-actions is -1"),
    "a threshold of NaN": (["--threshold-m", "nan"], "--threshold-m is nan"),
    "a threshold of zero": (["--threshold-m", "0"], "--threshold-m is 0"),
    "a threshold in millimetres": (["--threshold-m", "12"], "--threshold-m is 12"),
    "a negative threshold": (["--threshold-m", "-0.01"], "--threshold-m is -0.01"),
    "a negative seed": (["--seed", "-1"], "--seed is -1"),
    "an interactive goal without a viewer": (["--goal", "interactive"], "needs the viewer"),
    "an unknown DLO": (["--dlo", "spaghetti"], "soft_rope"),
    "an unknown observer": (["--observer", "crystal_ball"], "map, anchored, cpd, spr, som"),
    "an unknown segmentation": (["--segmentation", "smell"], "brightness, colour"),
    "a flag without its value": (["--config"], "has no value"),
    "a model of no length": (["--model.length-m", "0"], "length"),
    "a model of two nodes": (["--model.nodes", "2"], "nodes"),
}


@pytest.mark.parametrize("runtime", RUNTIMES)
@pytest.mark.parametrize(("arguments", "said"), BAD.values(), ids=BAD)
def test_bad_input_is_named_before_anything_starts(
    arguments: list[str], said: str, runtime: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = psutil.Process().children()  # of tests that ran earlier in this process
    with pytest.raises(InputError) as caught:
        execute(["shape", "--headless", "--runtime", runtime, *arguments])

    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert set(psutil.Process().children()) <= set(before)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("arguments", [["--seed", "one"], ["--runtime", "dead"], ["--colour", "red"]])
def test_what_the_parser_refuses_ends_with_2_and_points_to_the_help(
    arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        execute(["shape", *arguments])

    assert caught.value.code == 2
    assert "--help" in capfd.readouterr().err


CommandLine = Callable[[list[str]], object]


@pytest.fixture
def run_dlokit(monkeypatch: pytest.MonkeyPatch) -> Generator[CommandLine]:
    """The whole command line in this process; returns its exit code."""
    for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "MPLBACKEND"):  # its import sets them for its own process
        monkeypatch.setenv(name, os.environ.get(name, "egl"))
    from dlokit.app import main

    def run(arguments: list[str]) -> object:
        monkeypatch.setattr(sys, "argv", ["dlokit", *arguments])
        try:
            main.run(arguments)
        except SystemExit as ended:
            return ended.code
        return 0

    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_one_clear_line_and_no_traceback(run_dlokit: CommandLine, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_dlokit(["shape", "--headless", "--goal", "[red]Z[/red]"]) == EXIT_BAD_INPUT
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("dlokit: There is no shape '[red]Z[/red]'")


def test_output_works_on_an_ascii_terminal(run_dlokit: CommandLine, monkeypatch: pytest.MonkeyPatch) -> None:
    printed = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(printed, encoding="ascii", write_through=True))
    assert run_dlokit(["skills"]) == 0
    assert b"robot.stop" in printed.getvalue()


def test_the_version_is_that_of_the_package(run_dlokit: CommandLine, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_dlokit(["--version"]) == 0
    assert capsys.readouterr().out == f"dlokit {version('dlokit')}\n"


def _shape_args(*arguments: str) -> ShapeArgs:
    args = parse(["shape", *arguments])
    assert isinstance(args, ShapeArgs)
    return args


def test_the_main_settings_have_flags_without_a_prefix() -> None:
    run = _shape_args("--threshold-m", "0.02", "--max-actions", "7", "--seed", "3").run

    assert run.task.threshold_m == 0.02
    assert run.task.max_actions == 7
    assert run.seed == 3


def test_strategies_are_chosen_by_name_and_their_settings_are_flags() -> None:
    run = _shape_args("--observer", "cpd", "--observer.strategy.outlier-weight", "0.2", "--segmentation", "colour").run

    assert isinstance(run.observer.strategy, CpdConfig)
    assert run.observer.strategy.outlier_weight == 0.2
    assert isinstance(run.perception.segmentation, ColourConfig)


def test_a_dlo_preset_gives_the_model_only_length_and_radius() -> None:
    run = _shape_args("--dlo", "thin_wire").run

    assert run.cell.dlo.name == "thin_wire"
    assert run.model.radius_m == run.cell.dlo.radius_m
    assert run.model.length_m == run.cell.dlo.length_m
    assert run.model.bending_stiffness_n_m2 == RunConfig().model.bending_stiffness_n_m2
    assert run.model.friction == RunConfig().model.friction


def test_a_wire_stays_bent_in_the_cell_unless_configured_otherwise() -> None:
    assert _shape_args("--dlo", "wire-a").run.cell.physics == ElastoplasticChain()
    assert _shape_args("--dlo", "wire_a", "--physics", "rod").run.cell.physics == ElasticRod()
    assert _shape_args("--physics", "chain").run.cell.physics == ElastoplasticChain()
    assert _shape_args("--dlo", "silicone_hose").run.cell.physics == ElasticRod()
    with pytest.raises(ConfigError, match="rod, chain"):
        _shape_args("--physics", "glue")


def test_a_cell_is_randomised_on_request_completely_or_by_factors() -> None:
    assert _shape_args().run.cell.randomised == ()
    assert _shape_args("--randomised").run.cell.randomised == EVERY_FACTOR
    assert _shape_args("--cell.randomised", "light", "curl").run.cell.randomised == ("light", "curl")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--randomised", "--dlo", "wire_b"],
        ["--observer", "cpd", "--segmentation", "colour", "--dlo", "stiff_wire"],
        ["--seed", "4", "--start", "random", "--ends-interchangeable", "--threshold-m", "0.01"],
    ],
)
def test_what_a_run_writes_is_read_again_as_the_same(arguments: list[str], tmp_path: Path) -> None:
    first = _shape_args(*arguments).run
    written = tmp_path / "nan.csv"  # any name will do
    written.write_text(to_toml(first))

    assert _shape_args("--config", str(written)).run == first
    assert from_toml(to_toml(first), RunConfig, "first") == first


def test_the_command_line_overrides_the_configuration(tmp_path: Path) -> None:
    written = tmp_path / "nan.csv"
    written.write_text(to_toml(RunConfig(seed=5, headless=True)))

    assert _shape_args("--config", str(written), "--headless").run.headless
    run = _shape_args("--config", str(written), "--seed", "6", "--no-headless").run

    assert run.seed == 6
    assert not run.headless


def test_shape_files_are_kept_by_their_absolute_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[RunConfig] = []

    class Ended(Exception):
        pass

    def run_instead(config: RunConfig, **_: object) -> None:
        kept.append(config)
        raise Ended

    monkeypatch.setattr(shape_command, "check_before_start", run_instead)
    np.save(tmp_path / "many.npy", np.stack([builtin_shape("I", 0.5, 31, radius_m=0.004)] * 2))
    with pytest.raises(Ended):
        execute(["shape", "--goal", "many.npy:1", "--headless"])

    assert kept[0].goal == f"{tmp_path / 'many.npy'}:1"
    assert kept[0].start == "I"
