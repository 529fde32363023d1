"""What is checked before anything starts: the goal, the viewer's port, and whether pictures can be rendered."""

from dlokit import geometry
from dlokit.description.scene import default_calibration
from dlokit.errors import ShapeError
from dlokit.functional.cell.rendering import check_opengl
from dlokit.skills.planning.feasibility import check_goal
from dlokit.skills.robot.kinematics import PandaKinematics
from dlokit.skills.viewer.page import check_port
from dlokit.system.config import RunConfig
from dlokit.system.shaping import ShapeJob
from dlokit.types.arrays import Float64Array


def check_before_start(config: RunConfig, job: ShapeJob) -> None:
    """Raise `ShapeError` or `MachineError` for what would end the run anyway. The start is not judged here:

    where the DLO lies is for the system to see.
    """
    if job.request is not None:
        _check_goal(config, job.request.nodes_world)
    if not config.headless:
        check_port(config.viewer.host, config.viewer.port)
    check_opengl()


def _check_goal(config: RunConfig, goal_world: Float64Array) -> None:
    nodes = geometry.resample(goal_world, config.model.nodes)
    camera = default_calibration(config.cell.width_px, config.cell.height_px)
    planning = config.planning
    verdict = check_goal(nodes, planning.feasibility, planning.actions.grasp, PandaKinematics().reachable, camera)
    if not verdict.feasible:
        raise ShapeError(f"Goal {config.goal}: {verdict.text}")
