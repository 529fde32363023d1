"""The page of the bench shows the table that the bench runs."""

from pathlib import Path

from parts.faults.table import FAULTS, Fault

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "bench-faults.md"


def row(fault: Fault) -> str:
    right = " or ".join(map(str, fault.right)) + (", after `dlokit resume`" if fault.resumed else "")
    when = ", ".join(moment.value for moment in fault.when)
    return f"| `{fault.name}` | {fault.what} | {when} | {right} |"


def test_the_page_has_every_row_of_the_table_and_no_other() -> None:
    shown = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert shown == [row(fault) for fault in FAULTS]
