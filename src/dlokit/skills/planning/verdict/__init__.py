"""Whether a start or goal can be worked with, and the nearest shape that can."""
