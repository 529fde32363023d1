"""Figures of a bench, as JSON rows and as text."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from dlokit import __version__
from dlokit.errors import InputError
from dlokit.extras.bench.statistics import Interval
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_plain


@dataclass(frozen=True, kw_only=True)
class BenchFigure:
    """One row of the JSON file: one figure with its 95 % interval, in SI units."""

    case: str
    method: str
    metric: str
    value: float
    low: float | None
    high: float | None
    unit: str
    n: int


def figure(case: str, method: str, metric: str, interval: Interval, unit: str) -> BenchFigure:
    """The row of one figure with its interval."""
    return BenchFigure(
        case=case,
        method=method,
        metric=metric,
        unit=unit,
        **vars(interval),
    )


def check_json(path: Path | None) -> None:
    """Raise `InputError` if the folder of ``--json`` does not exist, before hours of results are lost."""
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(f"--json {path}: folder {path.resolve().parent} does not exist; create it or name another.")


def bench_json(
    bench: str, rows: Sequence[BenchFigure], machine: Mapping[str, str], config: RunConfig | Mapping[str, Any]
) -> bytes:
    """The content of the ``--json`` file; `config` is a run's configuration, or any other settings of the figures."""
    content = {
        "bench": bench,
        "version": __version__,
        "machine": dict(machine),
        "config": to_plain(config) if isinstance(config, RunConfig) else dict(config),
        "rows": [asdict(row) for row in rows],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"
