"""What ROS 2 publishes of a camera: images, clouds, calibrations and transforms, as dlokit's pictures."""
