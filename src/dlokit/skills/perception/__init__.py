"""Perception: from a pair of pictures to the DLO's points in the world."""
