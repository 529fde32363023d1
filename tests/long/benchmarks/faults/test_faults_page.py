"""The table of faults is complete, and the page shows it."""

from pathlib import Path

from dlokit.system.config import RunConfig
from dlokit.system.table import processes_of_run
from parts.faults.table import FAULTS, Fault

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "bench-faults.md"


def row(fault: Fault) -> str:
    right = " or ".join(map(str, fault.right)) + (", after `dlokit resume`" if fault.resumed else "")
    when = ", ".join(moment.value for moment in fault.when)
    return f"| `{fault.name}` | {fault.what} | {when} | {right} |"


def test_the_page_has_every_row_of_the_table_and_no_other() -> None:
    shown = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert shown == [row(fault) for fault in FAULTS]


def test_every_process_of_a_run_with_one_arm_is_killed_and_frozen() -> None:
    names = {fault.name for fault in FAULTS}
    for row in processes_of_run(RunConfig()):
        assert {f"kill-{row.name}", f"freeze-{row.name}"} <= names
