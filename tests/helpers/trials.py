"""A plan of the observer bench, run in the test's process."""

from collections.abc import Iterator

from dlokit.extras.bench.observers.runner import BenchPlan, Sequences, Trial, run_seeded_case


def run_plan(plan: BenchPlan) -> Iterator[Trial]:
    """Run all trials one after another in this process."""
    sequences = Sequences(plan.frames)
    for seeded in plan.seeded_cases:
        yield from run_seeded_case(seeded, sequences.of(seeded), plan.methods)
