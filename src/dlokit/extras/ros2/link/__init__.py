"""The link to the node of a ROS 2 workspace: its frames, and the socket at which the node connects."""
