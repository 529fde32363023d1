import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.plane_fit import fit_plane
from dlokit.types.arrays import Float64Array

INCLINED = Rotation.from_euler("xyz", [1.0, -0.5, 0.0], degrees=True)
TABLE = geometry.pose((0.0, 0.0, 0.08), INCLINED.as_quat(scalar_first=True))


def table(count: int = 3000, noise_m: float = 0.003) -> Float64Array:
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(0.3, 0.7, count), rng.uniform(-0.3, 0.3, count), rng.normal(0, noise_m, count)])
    return geometry.transform(TABLE, flat)


def on_the_table(count: int) -> Float64Array:
    """A box of 10 cm that stands on the table."""
    rng = np.random.default_rng(1)
    return geometry.transform(TABLE, rng.uniform((0.4, -0.1, 0.01), (0.6, 0.1, 0.10), (count, 3)))


def test_the_table_is_found_beneath_what_stands_on_it():
    fit = fit_plane(np.concatenate([table(3000), on_the_table(2000)]))
    assert np.degrees(fit.tilt_rad) == pytest.approx(np.hypot(1.0, 0.5), abs=0.05)
    np.testing.assert_allclose(fit.normal, geometry.rotation(TABLE)[:, 2], atol=2e-3)
    assert fit.frame.position_m[:2].tolist() == [0.0, 0.0]
    assert fit.frame.position_m[2] == pytest.approx(0.08, abs=1e-3)
    assert fit.rms_m == pytest.approx(0.003, rel=0.2)


def test_the_frame_lies_on_the_plane_with_z_as_its_normal_and_x_turned_least():
    fit = fit_plane(table())
    R = geometry.rotation(fit.frame)
    np.testing.assert_allclose(R[:, 2], fit.normal, atol=1e-9)
    assert R[1, 0] == pytest.approx(0.0, abs=1e-3)
    assert abs(float(geometry.transform(geometry.inverse(fit.frame), table()).mean(axis=0)[2])) < 5e-4


def test_few_points_a_wall_and_a_heap_are_refused():
    with pytest.raises(SkillFailure, match="at least 200"):
        fit_plane(table(100))
    wall = table()[:, [2, 1, 0]]
    with pytest.raises(SkillFailure, match="from level"):
        fit_plane(wall)
    with pytest.raises(SkillFailure, match="lie on one plane"):
        fit_plane(np.concatenate([table(1000), on_the_table(4000)]))
