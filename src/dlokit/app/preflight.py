"""What is checked before anything starts: the viewer's port, and whether pictures can be rendered."""

from dlokit.functional.cell.rendering import check_opengl
from dlokit.skills.viewer.page import check_port
from dlokit.system.config import RunConfig


def check_before_start(config: RunConfig) -> None:
    """Raise `MachineError` for what would end the run anyway. Shapes are not judged here.

    Where the DLO lies is for the system to see, and the goal is judged by the task itself, in the model.
    """
    if not config.headless:
        check_port(config.viewer.host, config.viewer.port)
    check_opengl()
