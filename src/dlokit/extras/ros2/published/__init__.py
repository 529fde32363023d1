"""What dlokit publishes in ROS 2: its topics, their messages, and the view of a run that makes them."""
