"""Colours and terms of the viewer: each kind of data has one colour, each technical term one explanation."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

from dlokit.types.action import KINDS
from dlokit.types.feasibility import Standing
from dlokit.types.flow import Mode

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class Layer:
    """A kind of data in the scene that can be shown and hidden."""

    title: str
    """Its name in the legend."""
    color: Rgb
    meaning: str
    """Its content, for the tooltip."""

    @property
    def slug(self) -> str:
        """Its name in the scene's tree."""
        return self.title.lower().replace(" ", "_")


ROBOT = Layer("Robot", (214, 218, 224), "The arm and its fingers, as their sensors report them")
CAMERA = Layer("Camera", (71, 85, 105), "The camera at its calibrated pose, with its last picture")
CLOUD = Layer("Cloud", (245, 158, 11), "The points of the DLO in the last picture")
TARGETS = Layer("Target points", (219, 39, 119), "The nodes of the DLO that the observer sees, without hidden ones")
STATE = Layer("Model state", (37, 99, 235), "The estimated shape, used for every decision")
GOAL = Layer("Goal", (22, 163, 74), "The requested shape")
NEAREST = Layer("Nearest that holds", (13, 148, 136), "The nearest shape found that friction holds and the arm reaches")
SPRING_BACK = Layer("Spring-back", (220, 38, 38), "The goal after its spring-back at the release")
CANDIDATES = Layer("Candidates", (192, 132, 252), "Predicted shapes after the best actions found so far")
ACTION = Layer("Action", (147, 51, 234), "The chosen action: gripper at grasp and release, path, expected shape")
FIXTURES = Layer("Fixtures", (236, 230, 218), "Posts and boxes on the table, where they are believed to stand")

LAYERS = (STATE, GOAL, NEAREST, SPRING_BACK, TARGETS, CLOUD, CANDIDATES, ACTION, ROBOT, CAMERA, FIXTURES)
"""In the order of the legend; a page without fixtures omits the last."""
PICTURE_LAYERS = (STATE, GOAL, FIXTURES)
"""Those that are drawn into the camera's picture."""

VERDICTS: Mapping[Standing, Rgb] = {
    Standing.HOLDS: (22, 163, 74),
    Standing.DOUBTFUL: (217, 119, 6),
    Standing.INFEASIBLE: (220, 38, 38),
}
"""Colours of the verdict on a goal."""

MODES: Mapping[Mode, Rgb] = {Mode.PLANNING: ACTION.color, Mode.CONTROL: (194, 65, 12)}
"""Colours of the modes in which the shape is changed."""

MASK_USED: Rgb = (236, 0, 180)
MASK_DROPPED: Rgb = (0, 190, 220)
"""Pixels of a picture that are the DLO, and those that are segmented without effect."""

TABLE_RGB: Rgb = (168, 156, 138)
TABLE_AREA_RGB: Rgb = (120, 108, 92)
ALIVE: Rgb = (22, 163, 74)
LOST: Rgb = (220, 38, 38)
GRIPPER_RGB: Rgb = (64, 68, 76)
STOP_CSS = "#dc2626"
INK = "#1e293b"
FAINT = "#94a3b8"
ACTIVE = "#fb923c"
PAPER = "#ffffff"


def css(color: Rgb) -> str:
    """A colour as style sheets write it."""
    return f"#{color[0]:02x}{color[1]:02x}{color[2]:02x}"


TERMS: Mapping[str, str] = {
    "RMSE": "Root mean square distance of the nodes of the DLO to their places in the goal, by dlokit's own estimate",
    "threshold": "The goal counts as reached when the RMSE is below this",
    "action": "Everything from one grasp to its release",
    "actions": "An action is everything from one grasp to its release",
    "rollouts": "Number of candidate actions simulated for this decision",
    "scores": "The lower, the better: the expected RMSE, plus what its uncertainty and a further action add",
    **{kind: facts.does for kind, facts in KINDS.items()},
    "planning mode": "An action is planned from grasp to release, then made",
    "control mode": "The grasped DLO is corrected in small steps, each after a new look",
    "health": "The observer's confidence in its estimate, 0 (lost) to 1",
    "restarts": "Number of times that another process took over the component",
}
"""Terms → their meaning."""


def term(word: str) -> str:
    """A term as HTML, with its meaning as a tooltip; a word outside `TERMS` is only escaped."""
    meaning = TERMS.get(word)
    if meaning is None:
        return escape(word)
    return f'<abbr title="{escape(meaning, quote=True)}" style="text-decoration:none;cursor:help">{escape(word)}</abbr>'
