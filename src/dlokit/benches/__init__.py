"""The benches, which compare methods and judge runs from outside."""
