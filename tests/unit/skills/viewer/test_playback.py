"""The player moves along the timeline of a recorded run as people expect it."""

import pytest

from dlokit.skills.viewer.playback import Mark, MarkKind, Player, RunTimeline, waits_between

TIMELINE = RunTimeline(
    name="I to S",
    recorded_at="2026-01-01 12:00",
    begin_ns=0,
    duration_s=20.0,
    marks=(
        Mark(time_s=1.0, kind=MarkKind.STEP, name="plan"),
        Mark(time_s=5.0, kind=MarkKind.ACTION, name="action 1"),
        Mark(time_s=6.0, kind=MarkKind.STEP, name="grasp"),
        Mark(time_s=12.0, kind=MarkKind.ACTION, name="action 2"),
        Mark(time_s=18.0, kind=MarkKind.END, name="task 1: converged"),
    ),
    waits=((2.0, 4.0), (13.0, 17.0)),
)


def player(at_s: float = 0.0, *, playing: bool = True) -> Player:
    made = Player(timeline=TIMELINE)
    made.seek(at_s)
    made.jumped, made.playing = False, playing
    return made


def test_it_moves_by_the_time_that_has_passed_at_its_speed_and_only_while_it_plays() -> None:
    moves = player()
    moves.speed = 2.0
    moves.advance(0.5)
    assert moves.position_s == 1.0
    moves.pause()
    moves.advance(0.5)
    assert moves.position_s == 1.0
    assert not moves.jumped


def test_a_wait_is_skipped_from_where_it_begins_unless_waits_are_kept() -> None:
    skips, keeps = player(1.9), player(1.9)
    keeps.skips_waits = False
    for each in (skips, keeps):
        each.advance(0.2)
    assert skips.position_s == 4.0
    assert keeps.position_s == pytest.approx(2.1)
    assert not skips.jumped  # what was passed over is shown as if it had been played


def test_it_pauses_at_the_end_and_plays_again_from_the_beginning() -> None:
    ends = player(19.9)
    ends.advance(1.0)
    assert (ends.position_s, ends.playing, ends.ended) == (20.0, False, True)
    ends.play()
    assert (ends.position_s, ends.playing, ends.jumped) == (0.0, True, True)


@pytest.mark.parametrize(("wanted_s", "reached_s"), [(7.0, 7.0), (-1.0, 0.0), (99.0, 20.0)])
def test_seeking_stays_within_the_run_and_plays_on_or_not_as_before(wanted_s: float, reached_s: float) -> None:
    for playing in (True, False):
        seeks = player(3.0, playing=playing)
        seeks.seek(wanted_s)
        assert (seeks.position_s, seeks.playing, seeks.jumped) == (reached_s, playing, True)


def test_next_and_previous_go_from_action_to_action_and_to_the_end_of_the_task() -> None:
    steps = player()
    visited: list[float] = []
    for _ in range(4):
        steps.next_action()
        visited.append(steps.position_s)
    assert visited == [5.0, 12.0, 18.0, 20.0]
    for _ in range(4):
        steps.previous_action()
        visited.append(steps.position_s)
    assert visited[4:] == [18.0, 12.0, 5.0, 0.0]


def test_previous_goes_to_the_beginning_of_the_action_that_runs() -> None:
    back = player(8.0)
    back.previous_action()
    assert back.position_s == 5.0


def test_each_step_lasts_until_the_next_one() -> None:
    assert TIMELINE.steps() == ((1.0, 6.0, "plan"), (6.0, 20.0, "grasp"))


def test_the_beginning_and_the_end_of_a_wait_are_kept_and_short_waits_whole() -> None:
    moving_s = [5.0, 5.1, 6.5, 9.0]
    assert waits_between(moving_s, 20.0, after_s=0.5, before_s=1.0) == ((0.5, 4.0), (7.0, 8.0), (9.5, 19.0))
    assert waits_between([], 10.0, after_s=0.5, before_s=1.0) == ((0.5, 9.0),)
