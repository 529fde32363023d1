"""The flow chart of shape manipulation (paper, Fig. 6), with the ends that are missing in the paper."""

from dataclasses import replace

from dlokit.decision.convergence import Progress
from dlokit.decision.flow import End, FaultKind, Flow, Step
from dlokit.decision.steps import act, control, goal, perceive, recover
from dlokit.decision.steps.outcomes import (
    Carried,
    Change,
    Checked,
    Controlled,
    Done,
    FixturesSeen,
    Found,
    GoalJudged,
    Grasped,
    Recovered,
    Restored,
    Sight,
)
from dlokit.decision.task import ShapeTask
from dlokit.types.flow import Mode, RunOutcome

SHAPE_DLO: Flow[ShapeTask] = Flow(
    name="shape_dlo",
    start="check_camera",
    steps=(
        Step(
            "check_camera",
            perceive.check_camera,
            {
                Checked.CORRECTED: "find_dlo",
                Checked.KEPT: "find_dlo",
                Checked.OFF: "find_dlo",
                FaultKind.FAILED: "failed",
            },
            "Look at the robot's own hand, whose pose is known: how far is the camera off its calibration?",
            motion="move the hand into the camera's picture, at two places",
        ),
        Step(
            "find_dlo",
            perceive.find_dlo,
            {
                Sight.SEEN: "set_goal",
                Sight.UNUSABLE: "infeasible",
                FaultKind.LOST: "restore",
                FaultKind.FAILED: "failed",
            },
            "Move the arms out of the picture, look, and order the cloud into the first shape.",
            motion="move the arms home, out of the camera's picture",
        ),
        Step(
            "set_goal",
            goal.set_goal,
            {
                Done.DONE: "judge_goal",
                FaultKind.LOST: "restore",
                FaultKind.FAILED: "failed",
            },
            "Send the goal to the model; the operator's goal is a shape that the rod can take.",
        ),
        Step(
            "judge_goal",
            goal.judge_goal,
            {
                GoalJudged.HOLDS: "track_model",
                GoalJudged.DOUBTFUL: "track_model",
                GoalJudged.PROJECTED: "track_model",
                GoalJudged.TRIED: "track_model",
                GoalJudged.REJECTED: "infeasible",
                GoalJudged.ASKED_AGAIN: "set_goal",
                FaultKind.FAILED: "failed",
            },
            "Does the rod stay in the goal when it is released there, in the model? Can the arm reach it?",
        ),
        Step(
            "track_model",
            perceive.track_model,
            {
                Sight.SEEN: "compare",
                Sight.UNUSABLE: "infeasible",
                FaultKind.LOST: "restore",
                FaultKind.FAILED: "failed",
            },
            "Look until the model, dragged to the target points, has settled.",
        ),
        Step(
            "compare",
            perceive.compare,
            {
                Progress.CONVERGED: "converged",
                Progress.NOT_YET: "choose_grasp",
                Progress.OUT_OF_ACTIONS: "budget_spent",
                Progress.OUT_OF_TIME: "budget_spent",
                Progress.STALLED: "stalled",
            },
            "Is the RMSE between shape and goal below the threshold?",
        ),
        Step(
            "choose_grasp",
            act.choose_grasp,
            {
                Found.FOUND: "approach",
                Found.NONE_LEFT: "stalled",
                Found.NO_GAIN: "stalled",
                FaultKind.FAILED: "failed",
            },
            "The planner's best action among the grasps that are not marked.",
            mode=Mode.PLANNING,
        ),
        Step(
            "approach",
            act.approach,
            {
                Done.DONE: "grasp",
                FaultKind.REFUSED: "mark_invalid",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Move above the grasp point in joint space.",
            mode=Mode.PLANNING,
            motion="move above the grasp point",
        ),
        Step(
            "grasp",
            act.grasp,
            {
                Grasped.HELD: "move_to_goal",
                Grasped.BESIDE: "push",
                Grasped.MISSED: "release",
                FaultKind.REFUSED: "release",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Move straight down, close, and feel whether the DLO is held; fingers that push are closed already.",
            mode=Mode.PLANNING,
            motion="move down and close the fingers",
        ),
        Step(
            "move_to_goal",
            act.move_to_goal,
            {
                Carried.DONE: "release",
                Carried.SLIPPED: "release",
                Carried.TO_CONTROL: "control",
                FaultKind.REFUSED: "release",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Lift, carry and lower along the planned path, while the model is tracked and the fingers are watched.",
            mode=Mode.PLANNING,
            motion="carry the DLO along the planned path",
        ),
        Step(
            "control",
            control.control,
            {
                Controlled.CORRECTED: "control",
                Controlled.SETTLED: "release",
                Controlled.DEADLOCK: "release",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Look at the held DLO, and correct the remaining error by a small motion of the tool.",
            mode=Mode.CONTROL,
            motion="correct the held DLO by a small motion",
        ),
        Step(
            "push",
            act.push,
            {
                Done.DONE: "release",
                FaultKind.REFUSED: "release",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Move the closed fingers across the table, pushing the rod.",
            mode=Mode.PLANNING,
            motion="push the DLO with closed fingers",
        ),
        Step(
            "release",
            act.release,
            {
                Done.DONE: "track_again",
                FaultKind.INTERRUPTED: "recover",
                FaultKind.FAILED: "failed",
            },
            "Open, move straight up and out of the picture.",
            motion="open the fingers, move up and out of the camera's picture",
        ),
        Step(
            "recover",
            recover.recover,
            {
                Recovered.DONE: "release",
                Recovered.CARRYING: "move_to_goal",
                Recovered.TOO_OFTEN: "failed",
                FaultKind.FAILED: "failed",
            },
            "The arm braked on its own: clear the fault; carry on with a DLO that is held, or release and look again.",
        ),
        Step(
            "restore",
            recover.restore,
            {
                Restored.BEGIN: "check_camera",
                Restored.LOOK_AGAIN: "track_again",
                FaultKind.LOST: "restore",
                Restored.TOO_OFTEN: "failed",
                FaultKind.FAILED: "failed",
            },
            "A component is gone: wait until its process is restarted, and send it what it must know.",
        ),
        Step(
            "track_again",
            perceive.track_again,
            {
                Done.DONE: "has_error_changed",
                FaultKind.LOST: "restore",
                FaultKind.FAILED: "failed",
            },
            "Look again until the model has settled.",
        ),
        Step(
            "has_error_changed",
            act.has_error_changed,
            {Change.CHANGED: "clear_marks", Change.UNCHANGED: "mark_invalid"},
            "Did the action change the error?",
        ),
        Step(
            "clear_marks",
            act.clear_marks,
            {Done.DONE: "compare"},
            "All grasp points are valid again, except those that failed from a shape like this one.",
        ),
        Step(
            "mark_invalid",
            act.mark_invalid,
            {Done.DONE: "compare"},
            "Do not take this grasp point again until the shape has changed.",
        ),
    ),
    ends=(
        End("converged", RunOutcome.CONVERGED),
        End("stalled", RunOutcome.STALLED),
        End("budget_spent", RunOutcome.BUDGET),
        End("infeasible", RunOutcome.INFEASIBLE),
        End("failed", RunOutcome.FAILED),
    ),
)

_UNTIL_AN_ACTION = ("check_camera", "find_dlo", "set_goal", "judge_goal", "track_model", "compare", "mark_invalid")
"""Steps that a dry run has in common with any run."""


def _dry_run() -> Flow[ShapeTask]:
    steps = {step.name: step for step in SHAPE_DLO.steps}
    choose, restore = steps["choose_grasp"], steps["restore"]
    return replace(
        SHAPE_DLO,
        steps=(
            *(steps[name] for name in _UNTIL_AN_ACTION),
            replace(choose, then={**choose.then, Found.FOUND: "rehearse"}),
            Step(
                "rehearse",
                act.rehearse,
                {
                    Done.DONE: "dry_run",
                    FaultKind.REFUSED: "mark_invalid",
                    FaultKind.FAILED: "failed",
                },
                "Make all motions of the action in software, each planned and checked; no arm moves.",
                mode=Mode.PLANNING,
            ),
            replace(restore, then={**restore.then, Restored.LOOK_AGAIN: "find_dlo"}),
        ),
        ends=(*SHAPE_DLO.ends, End("dry_run", RunOutcome.DRY_RUN)),
    )


DRY_RUN: Flow[ShapeTask] = _dry_run()
"""The same chart up to the first action, which arms in software make."""


def _among_fixtures(plain: Flow[ShapeTask]) -> Flow[ShapeTask]:
    """A chart that looks at the fixtures before the first motion, and again with the corrected camera."""
    steps = {step.name: step for step in plain.steps}
    check = Step(
        "check_fixtures",
        perceive.check_fixtures,
        {
            FixturesSeen.AS_BELIEVED: "check_camera",
            FixturesSeen.OTHERWISE: "infeasible",
            FaultKind.LOST: "restore",
            FaultKind.FAILED: "failed",
        },
        "Look at the table: do the fixtures stand where they are believed to be, and nothing else?",
    )
    again = replace(
        check,
        name="check_fixtures_again",
        run=perceive.check_fixtures_again,
        then={**check.then, FixturesSeen.AS_BELIEVED: "find_dlo"},
        doc="The same with the corrected camera, which tells smaller offsets, and with the arms out of its picture.",
        motion="move the arms home, out of the camera's picture",
    )
    camera, restore = steps["check_camera"], steps["restore"]
    changed = {
        camera.name: replace(camera, then={**camera.then, Checked.CORRECTED: again.name}),
        restore.name: replace(restore, then={**restore.then, Restored.BEGIN: check.name}),
    }
    return replace(
        plain, start=check.name, steps=(check, again, *(changed.get(step.name, step) for step in plain.steps))
    )


def task_chart(*, dry_run: bool, fixtures: bool) -> Flow[ShapeTask]:
    """The chart of a task; among fixtures it looks where they stand before an arm moves."""
    plain = DRY_RUN if dry_run else SHAPE_DLO
    return _among_fixtures(plain) if fixtures else plain


def resuming(plain: Flow[ShapeTask]) -> Flow[ShapeTask]:
    """A chart with an additional first step, for a task that another process had begun."""
    take_over: Step[ShapeTask, Done] = Step(
        "take_over",
        recover.take_over,
        {
            Done.DONE: plain.start,
            FaultKind.FAILED: "failed",
        },
        "After a crash or a stop: clear faults, lay what the fingers hold on the table, open them, move straight up.",
        motion="lay what the fingers hold on the table, open them, and move straight up",
    )
    return replace(plain, start=take_over.name, steps=(take_over, *plain.steps))
