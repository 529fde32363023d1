"""The timeline's drawing, badge and list."""

from dlokit.skills.viewer.panel.timeline import badge_html, listed, timeline_svg
from dlokit.skills.viewer.playback import Mark, MarkKind, RunTimeline

TIMELINE = RunTimeline(
    name="<I> to S",
    recorded_at="2026-01-01 12:00",
    begin_ns=0,
    duration_s=10.0,
    marks=(
        Mark(time_s=0.0, kind=MarkKind.STEP, name="plan"),
        Mark(time_s=2.0, kind=MarkKind.ACTION, name="task 2, action 1"),
        Mark(time_s=4.0, kind=MarkKind.STEP, name="<grasp>"),
        Mark(time_s=9.0, kind=MarkKind.END, name="task 1: converged"),
    ),
    waits=((0.5, 1.5),),
)


def test_the_badge_says_that_the_run_is_recorded_which_and_when() -> None:
    html = badge_html(TIMELINE)
    for text in ("RECORDED RUN", "&lt;I&gt; to S", "2026-01-01 12:00", "10.0 s", "watching it moves no arm"):
        assert text in html


def test_the_drawing_says_the_position_and_its_step_and_has_every_mark() -> None:
    html = timeline_svg(TIMELINE, 4.5)
    assert 'data-position="4.5"' in html
    assert "4.5 s  &lt;grasp&gt;</text>" in html
    for name in ("plan", "task 2, action 1", "task 1: converged"):
        assert f"<title>{name}</title>" in html


def test_names_of_steps_are_not_pale_where_waits_are_skipped() -> None:
    html = timeline_svg(TIMELINE, 4.5)
    assert html.rindex('fill-opacity="0.65"') < html.index(">plan</text>")


def test_an_action_is_marked_by_its_number_in_its_task() -> None:
    assert ">1<title>task 2, action 1</title>" in timeline_svg(TIMELINE, 4.5)


def test_a_step_is_named_from_the_moment_that_its_mark_goes_to() -> None:
    # Positions are rounded to the tenth of a second of the slider.
    timeline = RunTimeline(name="", recorded_at="", begin_ns=0, duration_s=10.0, marks=(
        Mark(time_s=0.0, kind=MarkKind.STEP, name="plan"),
        Mark(time_s=4.03, kind=MarkKind.STEP, name="grasp"),
    ))  # fmt: skip
    assert "4.0 s  grasp</text>" in timeline_svg(timeline, 4.0)


def test_an_empty_timeline_can_be_drawn() -> None:
    assert "0.0 s" in timeline_svg(RunTimeline(name="", recorded_at="", begin_ns=0, duration_s=0.0), 0.0)


def test_a_long_run_lists_actions_and_ends_only() -> None:
    many = tuple(Mark(time_s=float(number), kind=MarkKind.STEP, name="plan") for number in range(500))
    assert listed(TIMELINE.marks) == TIMELINE.marks
    assert [mark.name for mark in listed((*TIMELINE.marks, *many))] == ["task 2, action 1", "task 1: converged"]
