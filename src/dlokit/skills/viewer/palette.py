"""Colours of the viewer: each thing has one, in the scene, the legend and the plots."""

from collections.abc import Mapping
from dataclasses import dataclass

from dlokit.types.feasibility import Standing
from dlokit.types.flow import Mode

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class Layer:
    """One kind of data in the scene, that can be shown and hidden."""

    title: str
    """Its name in the legend."""
    color: Rgb

    @property
    def slug(self) -> str:
        """Its name in the scene's tree."""
        return self.title.lower().replace(" ", "_")


ROBOT = Layer("Robot", (214, 218, 224))
CAMERA = Layer("Camera", (71, 85, 105))
CLOUD = Layer("Cloud", (245, 158, 11))
TARGETS = Layer("Target points", (219, 39, 119))
STATE = Layer("Model state", (37, 99, 235))
GOAL = Layer("Goal", (22, 163, 74))
NEAREST = Layer("Nearest that holds", (13, 148, 136))
SPRING_BACK = Layer("Spring-back", (220, 38, 38))
CANDIDATES = Layer("Candidates", (192, 132, 252))
ACTION = Layer("Next action", (147, 51, 234))

LAYERS = (STATE, GOAL, NEAREST, SPRING_BACK, TARGETS, CLOUD, CANDIDATES, ACTION, ROBOT, CAMERA)
"""In the order of the legend."""

VERDICTS: Mapping[Standing, Rgb] = {
    Standing.HOLDS: (22, 163, 74),
    Standing.DOUBTFUL: (217, 119, 6),
    Standing.INFEASIBLE: (220, 38, 38),
}
"""Colours of the verdict on a goal."""

MODES: Mapping[Mode, Rgb] = {Mode.PLANNING: ACTION.color, Mode.CONTROL: (194, 65, 12)}
"""Colours of the modes in which the shape is changed."""

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
