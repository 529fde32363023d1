"""Length and radius from images of the cell."""

from dataclasses import replace

import numpy as np

from dlokit.communication import topics
from dlokit.description.arm.franka import PANDA
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.shapes import random_shape
from dlokit.extras.identification.measuring import measure
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.recording.reader import Recorded
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.types.flow import FlowStatus
from dlokit.types.message import Message


def recorded(topic: str, message: Message) -> Recorded:
    return Recorded(topic=topic, log_ns=0, message=message)


def test_length_and_radius_of_a_rope_are_measured_within_the_stated_uncertainty() -> None:
    dlo = replace(SOFT_ROPE, length_m=0.6, radius_m=0.003)
    cell = Cell(CellConfig(dlo=dlo, settle_s=0.1), seed=1000)
    cell.place_dlo(random_shape(np.random.default_rng(2), dlo.length_m, 200))
    look = [
        recorded(topics.ROBOT_STATE.name, cell.arm_state()),
        recorded(topics.STEREO_IMAGES.name, cell.capture()),
    ]
    cell.close()

    def at(step: str) -> Recorded:
        return recorded(topics.FLOW.name, FlowStatus(stamp_ns=0, flow="shape_dlo", step=step))

    size = measure([at("find_dlo"), *look, at("move_to_goal"), *look], PerceptionConfig(), BelievedDlo(), PANDA)
    assert size is not None
    assert size.looks == 1, "a rope that is carried is not measured"
    for figure, true in ((size.length_m, dlo.length_m), (size.radius_m, dlo.radius_m)):
        low, high = figure.interval(3.0)
        assert low < true < high
    assert measure([at("move_to_goal"), *look], PerceptionConfig(), BelievedDlo(), PANDA) is None
