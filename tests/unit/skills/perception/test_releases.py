import numpy as np

from dlokit import geometry
from dlokit.skills.perception.releases import Releases
from dlokit.types.observation import Gripped
from dlokit.types.robot import RobotMode, RobotState


def state(x_m: float, z_m: float = 0.011, *, holding: bool) -> RobotState:
    return RobotState(
        stamp_ns=0,
        robot="panda",
        q_rad=np.zeros(7),
        dq_rad_s=np.zeros(7),
        tau_nm=np.zeros(7),
        T_world_tcp=geometry.downward([x_m, 0.0, z_m], 0.0),
        finger_width_m=0.008,
        mode=RobotMode.IDLE,
        holding=holding,
    )


HOME = state(0.3, 0.5, holding=False)


def carried(*states: RobotState, let_go: RobotState) -> Releases:
    """What is known after a grip, some states while it lasts, and its end."""
    releases = Releases(highest_m=0.03)
    releases.gripped(Gripped(stamp_ns=0, robot="panda", node=3), states[0])
    for each in states:
        releases.moved(each)
    releases.gripped(Gripped(stamp_ns=1, robot="panda", node=None), let_go)
    return releases


def test_a_place_is_seen_once_and_only_when_the_arm_is_away():
    releases = carried(state(0.5, holding=True), state(0.6, holding=True), let_go=state(0.6, holding=False))
    assert releases.in_view([state(0.62, holding=False)]) == ()
    (release,) = releases.in_view([HOME])
    assert release.T_world_tcp.position_m[0] == 0.6
    assert not release.lifted
    assert releases.in_view([HOME]) == ()


def test_a_rod_that_was_lifted_on_the_way_is_told_apart():
    releases = carried(
        state(0.5, holding=True),
        state(0.55, 0.2, holding=True),
        state(0.6, holding=True),
        let_go=state(0.6, holding=False),
    )
    assert [release.lifted for release in releases.in_view([HOME])] == [True]


def test_a_rod_that_was_lost_on_the_way_or_let_fall_has_no_place():
    lost = carried(state(0.5, holding=True), state(0.6, holding=False), let_go=state(0.6, holding=False))
    never = carried(state(0.5, holding=False), let_go=state(0.5, holding=False))
    fallen = carried(state(0.5, 0.1, holding=True), let_go=state(0.5, 0.1, holding=False))
    assert [each.in_view([HOME]) for each in (lost, never, fallen)] == [(), (), ()]


def test_the_next_grip_makes_a_place_that_nobody_saw_worthless():
    releases = carried(state(0.5, holding=True), let_go=state(0.5, holding=False))
    releases.gripped(Gripped(stamp_ns=2, robot="panda", node=9), HOME)
    releases.gripped(Gripped(stamp_ns=3, robot="panda", node=None), HOME)
    assert releases.in_view([HOME]) == ()
