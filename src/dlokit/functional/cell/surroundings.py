"""What surrounds arm and DLO in the cell: the table, its texture, and the lamps."""

from functools import cache

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, TABLE_THICKNESS_M, Table
from dlokit.types.arrays import Float64Array, UInt8Array

_TEXTURE_PX = 1024
_TEXTURE_SEED = 20220
_TABLE_GREY = 62.0  # mean grey value of the table, dark enough for a brightness filter at 120
_SPECKLE_GREY = 16.0  # standard deviation of its grain, the texture for stereo matching


def table_rotation(tilt_deg: tuple[float, float]) -> Rotation:
    """Rotation of a table tilted about x and y [°], about the middle of its top."""
    return Rotation.from_rotvec([tilt_deg[0], tilt_deg[1], 0.0], degrees=True)


def table_height_m(places_world: ArrayLike, table: Table, tilt_deg: tuple[float, float]) -> Float64Array:
    """Height of a tilted table's top (K,) [m] at places (K, 2) [m]."""
    normal = table_rotation(tilt_deg).apply([0.0, 0.0, 1.0])
    return -(np.asarray(places_world, dtype=np.float64) - table.centre_m) @ normal[:2] / normal[2]


def add_table(
    spec: mujoco.MjSpec, table: Table, *, friction: float, tilt_deg: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Add the table, its top at z = 0, dark and grained so that stereo matching finds texture.

    A tilted table turns about the middle of its top.
    """
    rotation = table_rotation(tilt_deg)
    quat = rotation.as_quat(scalar_first=True)
    add_printed_material(spec, "table", table_texture())
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=rotation.apply([0.0, 0.0, -TABLE_THICKNESS_M / 2]) + np.array([*table.centre_m, 0.0]),
        quat=quat,
        size=[*table.half_size_m, TABLE_THICKNESS_M / 2],
        material="table",
        contype=0,
        conaffinity=0,
    )
    # A rod on a box has two contacts per edge, between which the load keeps changing: a plane has
    # one. It has no edge to fall over; the checks of shapes use the table's size.
    spec.worldbody.add_geom(
        name="table_top",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[*table.half_size_m, 0.1],
        pos=[*table.centre_m, 0.0],
        quat=quat,
        group=3,
        friction=[friction, 0.001, 0.0001],
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
    )


def add_printed_material(spec: mujoco.MjSpec, name: str, picture: UInt8Array) -> None:
    """Add a matt material that shows a picture (height, width, 3)."""
    height_px, width_px, _ = picture.shape
    kind = mujoco.mjtTexture.mjTEXTURE_2D
    texture = spec.add_texture(name=name, type=kind, width=width_px, height=height_px, nchannel=3)
    texture.data = picture.tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0, reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def add_lights(spec: mujoco.MjSpec, table: Table, *, shadows: bool, light: float = 1.0) -> None:
    """Add two lamps above the table, one from each side; `light` is a factor on their strength."""
    for name, position, strength in (("lamp_left", (0.2, 1.0, 2.0), 0.45), ("lamp_right", (0.9, -0.6, 2.0), 0.30)):
        target = np.array([*table.centre_m, 0.0])
        spec.worldbody.add_light(
            name=name,
            pos=position,
            dir=target - np.array(position),
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=[light * strength] * 3,
            specular=[0.05] * 3,
            ambient=[0.0] * 3,
            castshadow=shadows,
        )


@cache
def table_texture() -> UInt8Array:
    """Grain at three scales around a dark grey, (1024, 1024, 3), read-only, the same every time."""
    rng = np.random.default_rng(_TEXTURE_SEED)
    grain = np.zeros((_TEXTURE_PX, _TEXTURE_PX))
    for cell_px, weight in ((2, 1.0), (6, 0.8), (24, 0.5)):
        count = -(-_TEXTURE_PX // cell_px)
        coarse = rng.normal(size=(count, count))
        grain += weight * np.kron(coarse, np.ones((cell_px, cell_px)))[:_TEXTURE_PX, :_TEXTURE_PX]
    grey = _TABLE_GREY + _SPECKLE_GREY * grain / grain.std()
    texture = np.repeat(np.clip(grey, 8.0, 105.0).astype(np.uint8)[:, :, None], 3, axis=2)
    texture.setflags(write=False)
    return texture
