"""Where the camera stands: corrected by the table and by the robot's own hand."""
