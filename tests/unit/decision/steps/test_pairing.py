import numpy as np

from dlokit import geometry
from dlokit.decision.steps.pairing import place_in_tool


def test_a_held_node_is_beside_the_tool_centre_point_along_the_rod_and_between_the_fingers_across_it():
    T_world_tcp = geometry.downward([0.5, 0.1, 0.004], 0.3)
    along, across, up = geometry.rotation(T_world_tcp).T  # axes of the tool in the world
    node = T_world_tcp.position_m + 0.012 * along + 0.004 * across + 0.002 * up

    place = place_in_tool(node, T_world_tcp)

    assert np.allclose(place, [0.012, 0.0, 0.002], atol=1e-12)
