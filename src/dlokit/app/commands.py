"""The commands of `dlokit`, and what their arguments mean."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app import (
    bench,
    bench_shaping,
    call,
    certs,
    demo,
    doctor,
    export,
    graph,
    host,
    identify,
    info,
    ps,
    record,
    replay,
    resume,
    shape,
    skills,
    stop,
    track,
)
from dlokit.app.shape_defaults import shape_defaults, value_of

Command = (
    shape.ShapeArgs
    | demo.DemoArgs
    | track.TrackArgs
    | info.InfoArgs
    | export.ExportArgs
    | record.RecordArgs
    | replay.ReplayArgs
    | identify.IdentifyArgs
    | skills.SkillsArgs
    | call.CallArgs
    | stop.StopArgs
    | ps.PsArgs
    | resume.ResumeArgs
    | certs.CertsArgs
    | host.HostArgs
    | graph.GraphArgs
    | doctor.DoctorArgs
    | bench.BenchArgs
)


def parse(arguments: Sequence[str]) -> Command:
    """Arguments to one of the commands' argument classes; exits with 2 and a hint on a mistake."""
    defaults = shape_defaults(arguments) if "shape" in arguments[:1] else shape.ShapeArgs()
    shaping = _bench_shaping(arguments)
    if shaping is not None:
        arguments = ["bench", *arguments[2:]]  # which bench is no longer asked for
    commands = (
        Annotated[shape.ShapeArgs, tyro.conf.subcommand("shape", default=defaults)]
        | Annotated[demo.DemoArgs, tyro.conf.subcommand("demo")]
        | Annotated[track.TrackArgs, tyro.conf.subcommand("track")]
        | Annotated[bench.BenchArgs, tyro.conf.subcommand("bench", default=shaping or tyro.MISSING_NONPROP)]
        | Annotated[info.InfoArgs, tyro.conf.subcommand("info")]
        | Annotated[export.ExportArgs, tyro.conf.subcommand("export")]
        | Annotated[record.RecordArgs, tyro.conf.subcommand("record")]
        | Annotated[replay.ReplayArgs, tyro.conf.subcommand("replay")]
        | Annotated[identify.IdentifyArgs, tyro.conf.subcommand("identify")]
        | Annotated[call.CallArgs, tyro.conf.subcommand("call")]
        | Annotated[stop.StopArgs, tyro.conf.subcommand("stop")]
        | Annotated[resume.ResumeArgs, tyro.conf.subcommand("resume")]
        | Annotated[ps.PsArgs, tyro.conf.subcommand("ps")]
        | Annotated[certs.CertsArgs, tyro.conf.subcommand("certs")]
        | Annotated[host.HostArgs, tyro.conf.subcommand("host")]
        | Annotated[skills.SkillsArgs, tyro.conf.subcommand("skills")]
        | Annotated[graph.GraphArgs, tyro.conf.subcommand("graph")]
        | Annotated[doctor.DoctorArgs, tyro.conf.subcommand("doctor")]
    )
    return tyro.cli(
        commands,  # type: ignore[arg-type]  # a union is a type form, which tyro takes
        args=list(arguments),
        prog="dlokit",
        description="Bring cables, ropes and wires into the shape you want with a robot and a camera.",
        # A strategy is chosen by its flag (`--observer cpd`); its settings are flags like all others.
        config=(tyro.conf.AvoidSubcommands,),
    )


def _bench_shaping(arguments: Sequence[str]) -> bench.BenchArgs | None:
    """The defaults of `dlokit bench shaping --config FILE`; None for everything else. Raises `ConfigError`."""
    if tuple(arguments[:2]) != ("bench", "shaping") or (file := value_of(arguments, "--config")) is None:
        return None
    config = Path(file)
    return bench.BenchArgs(which=bench_shaping.ShapingArgs(config=config, run=bench_shaping.shaping_defaults(config)))


def execute(arguments: Sequence[str]) -> int:
    """Run one command and give its exit code."""
    match parse(arguments):
        case shape.ShapeArgs() as args:
            return shape.run(args)
        case demo.DemoArgs() as args:
            return demo.run(args)
        case track.TrackArgs() as args:
            return track.run(args)
        case info.InfoArgs() as args:
            return info.run(args)
        case export.ExportArgs() as args:
            return export.run(args)
        case record.RecordArgs() as args:
            return record.run(args)
        case replay.ReplayArgs() as args:
            return replay.run(args)
        case identify.IdentifyArgs() as args:
            return identify.run(args)
        case call.CallArgs() as args:
            return call.run_call(args)
        case stop.StopArgs() as args:
            return stop.run_stop(args)
        case resume.ResumeArgs() as args:
            return resume.run(args)
        case ps.PsArgs() as args:
            return ps.run(args)
        case skills.SkillsArgs() as args:
            return skills.run(args)
        case certs.CertsArgs() as args:
            return certs.run(args)
        case host.HostArgs() as args:
            return host.run(args)
        case graph.GraphArgs() as args:
            return graph.run(args)
        case doctor.DoctorArgs() as args:
            return doctor.run(args)
        case bench.BenchArgs() as args:
            return bench.run(args)
