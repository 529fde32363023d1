"""The fixtures that truly stand in the cell, and the forces between them and the arms: ground truth."""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.installation import Installation
from dlokit.description.scene import Fixture, Post
from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, LINK_BIT, ROBOT_BIT, ROLLING_M, WORLD_BIT
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.drawn_cell import DrawnCell, DrawnFixture, installed_fixtures
from dlokit.functional.cell.surroundings import add_printed_material, table_rotation
from dlokit.functional.cell.truth import NO_FORCES
from dlokit.types.arrays import Float64Array, RowArray, UInt8Array

_GRAIN_M = 0.003  # width of a grain: about two pixels of the camera
_GRAINS = 64  # along each side of the texture
_WOOD_RGB = (108.0, 84.0, 58.0)  # under the lamps darker than a brightness filter at 120 selects
_GRAIN = 0.16  # standard deviation of the colour, relative to it
_SEED = 20221


def true_fixtures(config: CellConfig, installation: Installation, drawn: DrawnCell) -> tuple[Fixture, ...]:
    """The fixtures of a cell at their true poses in the world, with their true friction.

    A tilted table carries its fixtures with it.
    """
    draws = {one.name: one for one in drawn.fixtures}
    tilt, centre = table_rotation(drawn.table_tilt_deg), np.array([*installation.table.centre_m, 0.0])

    def placed(fixture: Fixture) -> Fixture:
        if fixture.name not in draws and not any(drawn.table_tilt_deg):
            return fixture
        draw = draws.get(fixture.name, DrawnFixture(name=fixture.name))
        turned = tilt * Rotation.from_euler("xyz", draw.turned_deg, degrees=True)
        R = turned * Rotation.from_matrix(geometry.rotation(fixture.T_world_foot))
        foot = centre + tilt.apply(np.add(fixture.position_m, [*draw.offset_m, 0.0]) - centre)
        x, y, z = (float(each) for each in foot)
        roll, pitch, yaw = (float(angle) for angle in R.as_euler("xyz", degrees=True))
        friction = fixture.friction * draw.friction_factor
        return replace(fixture, position_m=(x, y, z), rpy_deg=(roll, pitch, yaw), friction=friction)

    return tuple(placed(fixture) for fixture in installed_fixtures(config, installation))


def add_fixtures(spec: mujoco.MjSpec, fixtures: Sequence[Fixture]) -> None:
    """Add fixtures, as geoms ``fixture/<name>``, that DLO and arms touch."""
    if fixtures:
        add_printed_material(spec, "fixture", _wood())
        material = spec.material("fixture")
        material.texuniform, material.texrepeat = True, [1.0 / (_GRAIN_M * _GRAINS)] * 2
    for fixture in fixtures:
        if isinstance(fixture, Post):
            shape, half_m = mujoco.mjtGeom.mjGEOM_CYLINDER, (fixture.diameter_m / 2, fixture.height_m / 2, 0.0)
        else:
            shape, half_m = mujoco.mjtGeom.mjGEOM_BOX, tuple(extent / 2 for extent in fixture.size_m)
        spec.worldbody.add_geom(
            name=f"fixture/{fixture.name}",
            type=shape,
            size=half_m,
            pos=fixture.corners_world.mean(axis=0),
            quat=fixture.T_world_foot.wxyz,
            material="fixture",
            # Not the bit of the world: of a chain they touch the links, not the feet inside the links as well.
            contype=LINK_BIT,
            conaffinity=WORLD_BIT | ROBOT_BIT | LINK_BIT,
            # Of two surfaces that touch the larger friction counts, unless one has priority.
            priority=1,
            condim=6,
            friction=[fixture.friction, ROLLING_M, ROLLING_M],
            solref=CONTACT_SOLREF,
            solimp=CONTACT_SOLIMP,
        )


def _wood() -> UInt8Array:
    """Brown with grain, (64, 64, 3), the same every time."""
    grain = 1.0 + _GRAIN * np.random.default_rng(_SEED).normal(size=(_GRAINS, _GRAINS, 1))
    return np.clip(grain * _WOOD_RGB, 8.0, 115.0).astype(np.uint8)


class FixtureForces:
    """The largest force so far between each link of an arm, fingers included, and each fixture."""

    def __init__(self, model: Any, data: Any, robots: Collection[str], fixtures: Sequence[Fixture]) -> None:
        """`robots` are the names of the arms of the model."""
        self._model, self._data, self._wrench = model, data, np.zeros(6)
        self._pairs: dict[tuple[int, int], tuple[str, str, float]] = {}
        """By the geoms of a contact, in either order: link, fixture, and the sign of the force."""
        for fixture, (geom, body) in itertools.product(fixtures, enumerate(model.geom_bodyid)):
            link, fixed = model.body(body).name, int(model.geom(f"fixture/{fixture.name}").id)
            if link.split("/")[0] in robots:
                self._pairs[geom, fixed] = link, fixture.name, 1.0
                self._pairs[fixed, geom] = link, fixture.name, -1.0
        self._largest: dict[tuple[str, str], tuple[float, int]] = {}
        self.rows: RowArray = NO_FORCES
        """The forces, a row for each link and fixture that have touched; replaced, never changed."""

    def note(self, stamp_ns: int) -> None:
        """Note the forces of the last physics step. Call after each step: 6 µs while nothing touches."""
        forces: dict[tuple[str, str], Float64Array] = {}  # of all contacts of a link with a fixture together, (3,) [N]
        for number, (first, second) in enumerate(self._data.contact.geom.tolist()):
            if (first, second) in self._pairs:
                link, fixture, sign = self._pairs[first, second]
                mujoco.mj_contactForce(self._model, self._data, number, self._wrench)
                force = sign * self._data.contact.frame[number].reshape(3, 3).T @ self._wrench[:3]
                forces[link, fixture] = forces.get((link, fixture), np.zeros(3)) + force
        for pair, force in forces.items():
            force_n = float(np.linalg.norm(force))
            if force_n > self._largest.get(pair, (0.0, 0))[0]:
                self._largest[pair] = force_n, stamp_ns
                rows = [(*at, *largest) for at, largest in sorted(self._largest.items())]
                self.rows = np.array(rows, NO_FORCES.dtype)
