"""dlokit: bring cables, ropes and wires into the shape you want with a robot and a camera."""
