"""Shape a DLO in the simulated cell: `ros2 launch dlokit_ros demo.launch.py`."""

from dlokit_ros.launching import bridge_and_dlokit


def generate_launch_description():
    """The node and `dlokit shape`."""
    options = {"start": "--start", "goal": "--goal"}
    return bridge_and_dlokit(["shape", "--runtime", "live"], options, {"start": "I", "goal": "S"})
