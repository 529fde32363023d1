"""A plan of the observer bench, run in the test's process."""

from collections.abc import Iterator

from dlokit.extras.bench.observers.runner import BenchPlan, Sequences, Trial, run_task


def run_plan(plan: BenchPlan) -> Iterator[Trial]:
    """Run all trials one after another in this process."""
    sequences = Sequences(plan.frames)
    for task in plan.tasks:
        yield from run_task(task, sequences.of(task), plan.methods)
