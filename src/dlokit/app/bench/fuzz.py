"""`dlokit bench fuzz`: damaged messages through every decoder of the bus."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.progress import Progress

from dlokit.app.commands import CliCommand, flag
from dlokit.bench.fuzz.campaign import ALLOWED_BYTES, FuzzResult, fuzz
from dlokit.bench.fuzz.decoders import all_decoders
from dlokit.bench.report import BenchFigure, bench_json
from dlokit.errors import ConfigError
from dlokit.system.results.run_record import machine_facts

FOUND = 1
"""Exit code when a decoder did not keep to what it promises."""


@dataclass(frozen=True, kw_only=True)
class FuzzArgs:
    """Send damaged messages through every decoder of the bus; exit code 1 when one crashes, hangs or asks too much."""

    count: int = 1_000_000
    """Messages."""
    seed: int = 0
    """Of the messages and of their damage."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write every figure to this file."""


def run_fuzz(args: FuzzArgs) -> int:
    """Damage, decode and print; exit code 0 when every message was decoded or refused."""
    if args.count < 1:
        raise ConfigError(f"--count {args.count} must be at least 1.")
    console, decoders = Console(), all_decoders()
    with Progress(console=console) as progress:
        task = progress.add_task(f"{len(decoders)} decoders", total=args.count)
        result = fuzz(decoders, args.count, args.seed, lambda so_far: progress.update(task, completed=so_far.messages))
        progress.update(task, completed=result.messages)
    console.print(
        f"{result.messages} damaged messages: {result.refused} refused, "
        f"{result.messages - result.refused - len(result.wrong)} understood, {len(result.wrong)} wrong; "
        f"slowest {result.slowest_s * 1e3:.1f} ms, most memory {result.largest_bytes / 2**20:.2f} MiB "
        f"of {ALLOWED_BYTES / 2**20:.0f} allowed"
    )
    for wrong in result.wrong[:10]:
        console.print(wrong[:2000], style="red")
    if args.json is not None:
        config = {"count": args.count, "seed": args.seed, "decoders": len(decoders)}
        args.json.write_bytes(bench_json("fuzz", _figures(result), machine_facts(), config))
        console.print(f"figures: {args.json}")
    return FOUND if result.wrong else 0


def _figures(result: FuzzResult) -> list[BenchFigure]:
    values = {
        ("messages", ""): result.messages,
        ("refused", ""): result.refused,
        ("wrong", ""): len(result.wrong),
        ("slowest message", "s"): result.slowest_s,
        ("most memory of a message", "byte"): result.largest_bytes,
    }
    return [
        BenchFigure(
            case="damaged messages",
            method="dlokit",
            metric=metric,
            value=value,
            low=None,
            high=None,
            unit=unit,
            n=result.messages,
        )
        for (metric, unit), value in values.items()
    ]


COMMAND = CliCommand(FuzzArgs, run_fuzz)
