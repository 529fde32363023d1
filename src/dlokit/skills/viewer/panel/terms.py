"""Tooltips for the technical terms on the page."""

from collections.abc import Mapping
from html import escape

from dlokit.types.action import KINDS

TERMS: Mapping[str, str] = {
    "RMSE": "Root mean square distance of the nodes of the DLO to their places in the goal, by dlokit's own estimate",
    "threshold": "The goal counts as reached when the RMSE is below this",
    "action": "Everything from one grasp to its release",
    "actions": "An action is everything from one grasp to its release",
    "rollouts": "Number of candidate actions simulated for this decision",
    "what would remain": "RMSE that the simulation expects after the action",
    **{kind: facts.does for kind, facts in KINDS.items()},
    "planning": "An action is planned from grasp to release, then made",
    "control": "The grasped DLO is corrected in small steps, each after a new look",
    "health": "The observer's confidence in its estimate, 0 (lost) to 1",
    "restarts": "Number of times that another process has taken the component over",
}
"""Terms → their meaning."""


def term(word: str) -> str:
    """A term as HTML, with its meaning as a tooltip; a word that is not in `TERMS` is only escaped."""
    meaning = TERMS.get(word)
    if meaning is None:
        return escape(word)
    return f'<abbr title="{escape(meaning, quote=True)}" style="text-decoration:none;cursor:help">{escape(word)}</abbr>'
