"""Track a DLO in the pictures of a running camera: `ros2 launch dlokit_ros track.launch.py colour:=… depth:=…`."""

from dlokit_ros.launching import bridge_and_dlokit

TOPICS = ("colour", "depth", "right", "cloud", "calibration")


def generate_launch_description():
    """The node and `dlokit track`."""
    return bridge_and_dlokit(["track", "--camera", "ros2"], {topic: f"--camera.{topic}" for topic in TOPICS})
