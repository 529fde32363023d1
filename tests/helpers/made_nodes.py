"""Frames as the node of a ROS 2 workspace sends them."""

from dlokit.extras.ros2.link import frames

HELLO = frames.Hello(
    version=frames.VERSION,
    distribution="jazzy",
    rmw="rmw_fastrtps_cpp",
    node="/dlokit",
    package="0.1.0",
    hashes={},
)


def framed(header: frames.FromNode | frames.ToNode, payload: bytes = b"") -> bytes:
    """The bytes of a frame."""
    return frames.encode(header, payload)
