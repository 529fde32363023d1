"""How often verdicts on goals are right: goals of several kinds, and the cell's physics as the judge."""
