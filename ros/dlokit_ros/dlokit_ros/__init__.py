"""dlokit in a ROS 2 workspace: a node that carries messages between ROS and dlokit, over a Unix socket."""

__version__ = "0.1.0"
