"""The verdict on a goal: holds, doubtful or infeasible, why, and the nearest shape that holds."""

from collections.abc import Awaitable, Callable

import msgspec

from dlokit import geometry
from dlokit.skills.planning.verdict.feasibility import (
    Workplace,
    bends,
    crossings,
    crowded,
    is_inside,
    length_finding,
    misfits,
    out_of_bounds,
    overlaps,
    parting_rmse_m,
    place_of,
)
from dlokit.skills.planning.verdict.friction_hold import HoldVerdict
from dlokit.skills.planning.verdict.within_reach import moved_inside, unreachable_rmse_m
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import Finding, GoalVerdict, Problem, Standing

TryGoal = Callable[[Float64Array], Awaitable[HoldVerdict]]
"""Releases the rod in a goal (M, 3) [m]; costs as much as a few simulated seconds."""

HOPELESS_FACTOR = 1.1
"""A goal is infeasible when even at best no shape within this many thresholds of it holds: more than 1, as the
shape that is looked for is a local optimum."""


async def judge(goal: GoalShape, threshold_m: float, *, place: Workplace, try_goal: TryGoal) -> GoalVerdict:
    """Judge a goal for the DLO of `place`, to be met to an RMSE of `threshold_m` [m].

    It holds when there is no finding. It is infeasible when no shape within the threshold would do, even if the
    rod is as soft and the table as rough as may be; else it is doubtful. A goal across itself is tried as if strands
    could pass: what counts is whether an open shape is near.
    """
    nodes = goal.nodes_world
    beyond = out_of_bounds(nodes, place)
    across = overlaps(nodes, place.dlo.radius_m)
    bent = bends(nodes, place.config)
    apart_m = parting_rmse_m(nodes, list(crossings(nodes[:, :2])), place.dlo.radius_m) if across else 0.0
    hold = None if apart_m > threshold_m else await try_goal(nodes)
    sprung = () if hold is None else _springs_back(hold, nodes, threshold_m, place)
    findings = (
        *beyond,
        *(_of_goal(finding, nodes, apart_m, threshold_m) for finding in across),
        *bent,
        *misfits(nodes, place.dlo.length_m),
        *sprung,
        *crowded(nodes, place),
    )
    hopeless = (
        hold is None
        or hold.attainable_rmse_m > HOPELESS_FACTOR * threshold_m
        or (bool(beyond) and unreachable_rmse_m(nodes, place) > threshold_m)
    )
    nearest = None if hold is None or not findings else _nearest(hold, place)
    return GoalVerdict(
        stamp_ns=goal.stamp_ns,
        standing=_standing(findings, hopeless=hopeless),
        threshold_m=threshold_m,
        goal_world=nodes,
        findings=findings,
        releases=() if hold is None else hold.releases,
        nearest_world=nearest,
        nearest_rmse_m=None if nearest is None else geometry.rmse_m(nearest, nodes),
    )


def _of_goal(across: Finding, nodes: Float64Array, apart_m: float, threshold_m: float) -> Finding:
    """Refuse a self-crossing goal if no open shape is within the threshold; otherwise it is doubtful."""
    near = apart_m <= threshold_m
    apart = f" (strands {across.amount * 1000.0:.1f} mm apart, diameter {across.limit * 1000.0:.1f} mm)"
    text = (
        f"The goal lies across or upon itself at {place_of(nodes, across.node)}{apart if across.limit else ''}; "
        f"the DLO can only be laid open. The nearest open shape is about {apart_m * 1000.0:.1f} mm (RMSE) from it, "
        f"{'within' if near else 'more than'} "
        f"the threshold of {threshold_m * 1000.0:.4g} mm: "
        + ("the arm may end in an open shape beside the goal." if near else "the goal is refused; lay it open.")
    )
    return msgspec.structs.replace(across, text=text)


def _standing(findings: tuple[Finding, ...], *, hopeless: bool) -> Standing:
    if hopeless:
        return Standing.INFEASIBLE
    return Standing.DOUBTFUL if findings else Standing.HOLDS


def _nearest(hold: HoldVerdict, place: Workplace) -> Float64Array | None:
    """The nearest shape that holds (M, 3) [m], moved to where it can be worked with; None when it breaks a rule."""
    if hold.nearest_world is None:
        return None
    moved = moved_inside(hold.nearest_world, lambda nodes: is_inside(nodes, place))
    if moved is None or overlaps(moved, place.dlo.radius_m) or bends(moved, place.config):
        return None
    return None if misfits(moved, place.dlo.length_m) or crowded(moved, place) else moved


def _springs_back(hold: HoldVerdict, nodes: Float64Array, threshold_m: float, place: Workplace) -> tuple[Finding, ...]:
    believed, worst = hold.releases[0], max(hold.releases, key=lambda release: release.rmse_m)
    allowed_m = place.config.hold_fraction * threshold_m
    if worst.rmse_m <= allowed_m:
        return ()
    text = (
        f"Released there the DLO springs back by {believed.rmse_m * 1000.0:.1f} mm (RMSE), farthest by "
        f"{believed.largest_m * 1000.0:.1f} mm at {place_of(nodes, believed.node)}; by up to "
        f"{worst.rmse_m * 1000.0:.1f} mm (RMSE) as far as its stiffness and friction are in doubt. At most "
        f"{allowed_m * 1000.0:.3g} mm are allowed. Use wider bends, or a larger threshold."
    )
    return (length_finding(Problem.SPRINGS_BACK, believed.node, worst.rmse_m, allowed_m, text),)
