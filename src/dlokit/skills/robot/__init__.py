"""Robot control: kinematics, trajectories, checks, and the skills that move the arm and the gripper."""
