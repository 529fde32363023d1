"""The fixtures that truly stand in the cell, and the forces between them and the arms: ground truth."""

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
from dlokit.functional.cell.truth import NO_FORCES, Forces
from dlokit.types.arrays import Float64Array, UInt8Array

_MATERIAL = "fixture"
_GRAIN_M = 0.003  # width of a stripe of the grain: about two pixels of the camera
_GRAIN_STRIPES = 64
_WOOD_RGB = (108.0, 84.0, 58.0)  # under the lamps darker than a brightness filter at 120 selects
_GRAIN_GREY = 0.16  # standard deviation of the grain, of the colour
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
        add_printed_material(spec, _MATERIAL, _wood())
        material = spec.material(_MATERIAL)
        material.texuniform = True
        material.texrepeat = [1.0 / (_GRAIN_M * _GRAIN_STRIPES)] * 2
    for fixture in fixtures:
        shape, size_m, height_m = _geom(fixture)
        spec.worldbody.add_geom(
            name=_geom_name(fixture),
            type=shape,
            size=size_m,
            pos=geometry.transform(fixture.T_world_foot, [[0.0, 0.0, height_m / 2.0]])[0],
            quat=fixture.T_world_foot.wxyz,
            material=_MATERIAL,
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


class FixtureForces:
    """The largest force so far between each link of an arm, fingers included, and each fixture."""

    def __init__(self, model: Any, data: Any, robots: Collection[str], fixtures: Sequence[Fixture]) -> None:
        """`robots` are the names of the arms of the model."""
        self._model, self._data = model, data
        links = [model.body(body).name for body in model.geom_bodyid]
        # A flex is geom -1 of its contacts: the last entry.
        self._links = ["" if name.split("/")[0] not in robots else name for name in (*links, "")]
        self._is_link = np.array([name != "" for name in self._links])
        self._fixtures = {int(model.geom(_geom_name(fixture)).id): fixture.name for fixture in fixtures}
        self._is_fixture = np.isin(np.arange(len(self._links)), list(self._fixtures))
        self._largest: dict[tuple[str, str], tuple[float, int]] = {}
        self.rows: Forces = NO_FORCES
        """The forces, a row for each link and fixture that have touched; replaced, never changed."""

    def note(self, stamp_ns: int) -> None:
        """Take note of the contacts of the last physics step. Call after each step."""
        geoms = np.asarray(self._data.contact.geom)  # (K, 2)
        touching = self._is_link[geoms].any(axis=1) & self._is_fixture[geoms].any(axis=1)
        if not touching.any():
            return
        changed = False
        for pair, force in self._forces(geoms, np.flatnonzero(touching)).items():
            force_n = float(np.linalg.norm(force))
            if force_n > self._largest.get(pair, (0.0, 0))[0]:
                self._largest[pair], changed = (force_n, stamp_ns), True
        if changed:
            rows = [(*pair, *largest) for pair, largest in sorted(self._largest.items())]
            self.rows = np.array(rows, dtype=NO_FORCES.dtype)

    def _forces(self, geoms: Any, numbers: Any) -> dict[tuple[str, str], Float64Array]:
        """The force (3,) [N], of all their contacts together, of each link on each fixture."""
        found: dict[tuple[str, str], Float64Array] = {}
        wrench = np.zeros(6)
        for number in numbers:
            mujoco.mj_contactForce(self._model, self._data, number, wrench)
            first, second = (int(geom) for geom in geoms[number])
            force = self._data.contact.frame[number].reshape(3, 3).T @ wrench[:3]
            link, fixture, sign = (first, second, 1.0) if second in self._fixtures else (second, first, -1.0)
            pair = self._links[link], self._fixtures[fixture]
            found[pair] = found.get(pair, np.zeros(3)) + sign * force
        return found


def _geom_name(fixture: Fixture) -> str:
    return f"fixture/{fixture.name}"


def _geom(fixture: Fixture) -> tuple[mujoco.mjtGeom, list[float], float]:
    """Kind, size of MuJoCo, and height [m]."""
    if isinstance(fixture, Post):
        return mujoco.mjtGeom.mjGEOM_CYLINDER, [fixture.diameter_m / 2, fixture.height_m / 2, 0.0], fixture.height_m
    return mujoco.mjtGeom.mjGEOM_BOX, [extent / 2.0 for extent in fixture.size_m], fixture.size_m[2]


def _wood() -> UInt8Array:
    """Brown with grain, (64, 64, 3), the same every time."""
    grain = 1.0 + _GRAIN_GREY * np.random.default_rng(_SEED).normal(size=(_GRAIN_STRIPES, _GRAIN_STRIPES, 1))
    return np.clip(grain * _WOOD_RGB, 8.0, 115.0).astype(np.uint8)
