"""The annexes: what a reader of the heart need not know, a room each. They join by entry points."""
