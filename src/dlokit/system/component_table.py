"""Which class stands behind each component's name, for who needs to know the skills of all of them."""

from dlokit.communication.component import Component
from dlokit.decision.component import DecisionComponent
from dlokit.description.arm.mounts import OPPOSITE
from dlokit.functional.cell.component import CellComponent
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.observer.component import ObserverComponent
from dlokit.skills.perception.component import PerceptionComponent
from dlokit.skills.planning.component import PlanningComponent
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.viewer.component import ViewerComponent

COMPONENTS: dict[str, type[Component]] = {
    "cell": CellComponent,
    "robot": RobotComponent,
    f"robot.{OPPOSITE}": RobotComponent,
    "perception": PerceptionComponent,
    "observer": ObserverComponent,
    "model": ModelComponent,
    "planning": PlanningComponent,
    "viewer": ViewerComponent,
    "decision": DecisionComponent,
}
"""Every component by its name, as `dlokit.system.build` makes them."""
