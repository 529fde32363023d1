"""Which nodes the DLO hides by lying across itself: seen from the camera, another part of it is in front."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dlokit.skills.observer.visibility import in_camera
from dlokit.types.image import CameraCalibration

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def behind_itself(nodes_world: Array, radius_m: float, calibration: CameraCalibration | None) -> Flags:
    """Whether another part of a chain hides each node (M, 3) [m] from the camera, (M,).

    A node is hidden when its middle lies in the picture of a piece between two other nodes (a strip as wide as
    the rod of `radius_m` [m]) and clearly farther away: parts that touch are a diameter apart, and three quarters
    of one will do, because nodes are estimates. Without a calibration nothing is known to be hidden.
    """
    if calibration is None or len(nodes_world) < 4:
        return np.zeros(len(nodes_world), dtype=np.bool_)
    return behind_in_camera(in_camera(nodes_world, calibration), radius_m)


@njit(cache=True)
def behind_in_camera(p_camera: Array, radius_m: float) -> Flags:
    """`behind_itself` for nodes (M, 3) [m] in the camera's frame, in its picture u = x / z, v = y / z."""
    count = len(p_camera)
    hidden = np.zeros(count, dtype=np.bool_)
    z = p_camera[:, 2]
    before_camera = z > 1e-6
    depth = np.where(before_camera, z, 1.0)
    u, v = p_camera[:, 0] / depth, p_camera[:, 1] / depth
    for node in range(count):
        if not before_camera[node]:
            continue
        for piece in range(count - 1):
            if piece in (node - 1, node) or not (before_camera[piece] and before_camera[piece + 1]):
                continue
            du, dv = u[piece + 1] - u[piece], v[piece + 1] - v[piece]
            square = max(du * du + dv * dv, 1e-18)
            share = ((u[node] - u[piece]) * du + (v[node] - v[piece]) * dv) / square
            share = min(max(share, 0.0), 1.0)
            # Along a straight piece 1 / z runs linearly in the picture.
            nearer = 1.0 / ((1.0 - share) / z[piece] + share / z[piece + 1])
            off_u, off_v = u[node] - u[piece] - share * du, v[node] - v[piece] - share * dv
            if (off_u * off_u + off_v * off_v) * nearer * nearer > radius_m * radius_m:
                continue
            if z[node] - nearer > 1.5 * radius_m:
                hidden[node] = True
                break
    return hidden
