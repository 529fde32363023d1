"""Stiffness, friction and set of a DLO, identified from recorded clouds."""
