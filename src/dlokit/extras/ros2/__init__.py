"""ROS 2: a camera, the estimated shape and recordings, through a node in the lab's own workspace."""
