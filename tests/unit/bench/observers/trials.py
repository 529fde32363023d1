"""A plan of the bench of observers, run in the process of the test."""

from collections.abc import Iterator

from dlokit.bench.observers.runner import BenchPlan, Sequences, Trial, run_task


def run_plan(plan: BenchPlan) -> Iterator[Trial]:
    """Every trial, one after another, here."""
    sequences = Sequences(plan.frames)
    for task in plan.tasks:
        yield from run_task(task, sequences.of(task), plan.methods)
