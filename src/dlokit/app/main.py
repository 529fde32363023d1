"""The command line `dlokit`."""

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

import logging  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Annotated  # noqa: E402

import tyro  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.logging import RichHandler  # noqa: E402

from dlokit.app import bench, demo, doctor, graph, shape, track  # noqa: E402
from dlokit.errors import ConfigError, DlokitError, InputError  # noqa: E402
from dlokit.system.config import RunConfig  # noqa: E402
from dlokit.system.toml_config import read_toml  # noqa: E402

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
EXIT_FAULT = 1

Command = shape.ShapeArgs | demo.DemoArgs | track.TrackArgs | graph.GraphArgs | doctor.DoctorArgs | bench.BenchArgs


def parse(arguments: Sequence[str]) -> Command:
    """Arguments to one of the commands' argument classes; exits with 2 and a hint on a mistake."""
    shape_default = shape.ShapeArgs(run=_configured(arguments))
    commands = (
        Annotated[shape.ShapeArgs, tyro.conf.subcommand("shape", default=shape_default)]
        | Annotated[demo.DemoArgs, tyro.conf.subcommand("demo")]
        | Annotated[track.TrackArgs, tyro.conf.subcommand("track")]
        | Annotated[bench.BenchArgs, tyro.conf.subcommand("bench")]
        | Annotated[graph.GraphArgs, tyro.conf.subcommand("graph")]
        | Annotated[doctor.DoctorArgs, tyro.conf.subcommand("doctor")]
    )
    return tyro.cli(
        commands,  # type: ignore[arg-type]  # a union is a type form, which tyro takes
        args=list(arguments),
        prog="dlokit",
        description="Bring cables, ropes and wires into the shape you want with a robot and a camera.",
        config=(tyro.conf.CascadeSubcommandArgs,),
    )


def _configured(arguments: Sequence[str]) -> RunConfig:
    """The configuration that ``--config FILE`` names, which the other arguments then change."""
    for index, argument in enumerate(arguments):
        if argument == "--config":
            if index + 1 == len(arguments):
                raise ConfigError("--config lacks its file: give the config.toml of a run.")
            return read_toml(Path(arguments[index + 1]), RunConfig)
        if argument.startswith("--config="):
            return read_toml(Path(argument.removeprefix("--config=")), RunConfig)
    return RunConfig()


def execute(arguments: Sequence[str]) -> int:
    """Run one command and give its exit code."""
    match parse(arguments):
        case shape.ShapeArgs() as args:
            return shape.run(args)
        case demo.DemoArgs() as args:
            return demo.run(args)
        case track.TrackArgs() as args:
            return track.run(args)
        case graph.GraphArgs() as args:
            return graph.run(args)
        case doctor.DoctorArgs() as args:
            return doctor.run(args)
        case bench.BenchArgs() as args:
            return bench.run(args)


def main() -> None:
    """Entry point: one clear line for bad input, a traceback for nothing but our own mistakes."""
    errors = Console(stderr=True)
    logging.basicConfig(
        level=logging.WARNING, format="%(message)s", handlers=[RichHandler(console=errors, show_path=False)]
    )
    try:
        code = execute(sys.argv[1:])
    except InputError as error:
        errors.print(f"[bold red]dlokit:[/] {error}", highlight=False, soft_wrap=True)
        code = EXIT_BAD_INPUT
    except DlokitError as error:
        errors.print(f"[bold red]dlokit:[/] {type(error).__name__}: {error}", highlight=False, soft_wrap=True)
        code = EXIT_FAULT
    except KeyboardInterrupt:
        errors.print("[bold]dlokit:[/] stopped")
        code = EXIT_INTERRUPTED
    sys.exit(code)
