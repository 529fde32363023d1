"""A run that is ending says what one more Ctrl-C costs, and a program ends at once by a person or a time limit only."""

from collections.abc import Callable

import pytest

from dlokit.system.signals import ENDS_WITHIN_S, LastResort


class Program:
    """What the person sees, when the program leaves, and the time."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.left: list[str] = []
        self.limits: list[tuple[float, Callable[[], object]]] = []
        self.now_s = 0.0
        self.resort = LastResort(
            self.said.append,
            leave=self.left.append,
            after=lambda seconds, function: self.limits.append((seconds, function)),
            now_s=lambda: self.now_s,
        )


def test_the_first_ctrl_c_of_an_ending_run_only_says_what_the_next_one_costs() -> None:
    program = Program()
    program.resort.press()
    (line,) = program.said
    for cost in ("Ctrl-C again ends the program at once", "brake on their own", "result.json", "recording is readable"):
        assert cost in line
    assert program.left == []


def test_a_key_that_is_held_down_does_not_end_the_program_before_its_cost_can_be_read() -> None:
    program = Program()
    for _ in range(30):
        program.resort.press()
        program.now_s += 0.03
    assert len(program.said) == 1
    assert program.left == []
    program.now_s += 0.2
    program.resort.press()
    (why,) = program.left
    assert why.startswith("ended at once")
    assert "result.json" in why


def test_a_program_whose_run_does_not_end_is_ended_after_the_limit_that_it_has_announced() -> None:
    program = Program()
    assert program.resort.begin() == f"at most {ENDS_WITHIN_S:g} s"
    ((seconds, leave),) = program.limits
    assert seconds == ENDS_WITHIN_S
    assert program.left == []
    leave()
    (why,) = program.left
    assert why.startswith(f"the run did not end within {ENDS_WITHIN_S:g} s")


@pytest.mark.parametrize("error", [RuntimeError("reentrant call"), BrokenPipeError(), SystemExit(1)])
def test_a_cost_that_could_not_be_printed_is_said_at_the_next_ctrl_c(error: BaseException) -> None:
    errors, said, left = [error], list[str](), list[str]()

    def say(line: str) -> None:
        if errors:
            raise errors.pop()
        said.append(line)

    resort = LastResort(say, leave=left.append, after=lambda seconds, function: None, now_s=lambda: 100.0)
    resort.press()
    resort.press()
    assert len(said) == 1
    assert left == []
