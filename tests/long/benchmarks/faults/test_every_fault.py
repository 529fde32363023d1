"""Live runs with injected faults, as in the study of faults: each row of its table once."""

import asyncio
from pathlib import Path

import pytest

from parts.faults.judging import faults_of
from parts.faults.table import FAULTS, Fault
from parts.faults.trial import FaultCase, try_case


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_run_with_an_injected_fault_ends_as_specified(tmp_path: Path, fault: Fault) -> None:
    finding = asyncio.run(try_case(FaultCase(fault=fault, number=0), tmp_path / "case"))
    assert finding.struck or finding.skipped, finding.broken
    if finding.struck:
        wrong = faults_of(finding, fault)
        assert wrong == (), "\n".join((*wrong, repr(finding), *_results(tmp_path)))


def _results(folder: Path) -> list[str]:
    """The results of the runs in a folder: camera, actions and recoveries explain an end that was not required."""
    return [f"{path}: {path.read_text(encoding='utf-8')}" for path in sorted(folder.rglob("result.json"))]
