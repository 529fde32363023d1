"""The end of `make test`: what failed, a line each, and one sum over all of its parts.

    python tests/helpers/summary.py FOLDER PART [PART ...]

Reads FOLDER/PART.xml, as `pytest --junitxml` writes it. Exit code 1 where a test failed or a part left no results.
"""

import sys
from pathlib import Path
from xml.etree import ElementTree


def main(folder: Path, parts: list[str]) -> int:
    """Print the sum of the named parts."""
    passed, skipped, failed = 0, 0, list[str]()
    for part in parts:
        try:
            cases = list(ElementTree.parse(folder / f"{part}.xml").iter("testcase"))
        except (OSError, ElementTree.ParseError) as error:
            failed.append(f"{part}: it left no results ({error}); it was stopped, or pytest could not start")
            continue
        for case in cases:
            faults = [fault for kind in ("failure", "error") for fault in case.iter(kind)]
            failed += [f"{_name(case)} - {_first_line(fault)}" for fault in faults]
            skipped += not faults and case.find("skipped") is not None
            passed += not faults and case.find("skipped") is None
    print()
    for line in failed:
        print(f"FAILED {line}")
    print(f"{passed} passed, {len(failed)} failed, {skipped} skipped")
    return 1 if failed else 0


def _name(case: ElementTree.Element) -> str:
    """A case as `pytest` takes it on its command line."""
    path = case.get("classname", "").replace(".", "/")
    return f"{path}.py::{case.get('name')}" if path else str(case.get("name"))


def _first_line(fault: ElementTree.Element) -> str:
    return (fault.get("message") or "").partition("\n")[0][:160]


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
