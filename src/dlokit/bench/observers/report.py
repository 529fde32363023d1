"""The JSON file of the bench of observers."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import msgspec

from dlokit import __version__
from dlokit.bench.observers.cases import TUNING_SEED, Case
from dlokit.bench.observers.methods import PUBLISHED, default_name
from dlokit.bench.observers.runner import Plan
from dlokit.bench.report import Figure


def observers_json(rows: Sequence[Figure], machine: Mapping[str, str], plan: Plan, *, jobs: int = 1) -> bytes:
    """The file that ``--json`` writes; `config.default` names the default observer."""
    content: dict[str, Any] = {
        "bench": "observers",
        "version": __version__,
        "machine": dict(machine),
        "config": {
            "default": default_name(),
            "peers": [name for name in PUBLISHED if name != default_name()],
            "methods": {method.name: msgspec.to_builtins(method.config) for method in plan.methods},
            "cases": {case.name: _conditions(case) for case in plan.cases},
            "seeds": [plan.first_seed, plan.first_seed + plan.seeds - 1],
            "tuning_seeds_from": TUNING_SEED,
            "frames": plan.frames,
            "jobs": jobs,
            "threads_a_process": 1,
            "times_comparable": jobs == 1,
        },
        "rows": [asdict(row) for row in rows],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def _conditions(case: Case) -> dict[str, Any]:
    return {
        "motion": str(case.file) if case.file else case.motion,
        "pace": case.pace,
        **msgspec.to_builtins(case.conditions),
    }
