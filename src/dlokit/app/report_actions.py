"""The part of a report that sets what was expected of each action against what became of it."""

from dlokit.app import report_action_figures
from dlokit.system.run_record import RunRecord


def expected_section(record: RunRecord) -> str:
    """Expected against achieved, as shapes and as errors; empty where no action was predicted."""
    if not any(action.expected_world is not None for action in record.actions):
        return ""
    views, errors = report_action_figures.expected_shapes(record), report_action_figures.expected_errors(record)
    return (
        '<div class="columns">'
        f"<section><h2>Expected and achieved, action by action</h2>{views}</section>"
        f"<section><h2>Expected against achieved error</h2>{errors}</section></div>"
    )
