"""How bodies meet in MuJoCo: who meets whom, and how hard a contact is."""

WORLD_BIT = 1
"""Table, rod, and whatever else there is."""
ROBOT_BIT = 2
"""A robot's shapes meet the world but not one another: they overlap at the joints."""
LINK_BIT = 4
"""Links of a chain meet one another and the robot; on the table they stand on feet."""

CONTACT_SOLREF = (0.004, 1.0)
"""Time constant [s] and damping ratio of contacts that do not creep, common to table, rod and pads."""
CONTACT_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Impedance of contacts that do not creep: static friction creeps with ``1 - solimp[0]``."""
ROLLING_M = 0.001
"""Resistance to rolling and turning on the spot [m]: without it a released rod rolls away like a steel bar."""
