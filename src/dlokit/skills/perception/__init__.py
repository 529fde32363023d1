"""Perception: from pictures to the DLO's points in the world."""
