"""The browser viewer (paper, section 4): sees all data, and lets the operator drag a goal."""
