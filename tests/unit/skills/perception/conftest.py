import numpy as np
import pytest
from stereo_scene import Scene, render, s_curve


@pytest.fixture(scope="session")
def s_scene() -> Scene:
    """A rope in the shape of an S on the table, the robot at home."""
    return render(s_curve())


@pytest.fixture(scope="session")
def straight_scene() -> Scene:
    """A straight rope along the rows of the picture, held 0.1 m above the table: the hardest case for stereo."""
    t = np.linspace(-1.0, 1.0, 81)
    return render(np.column_stack([0.52 + 0.25 * t, 0.0 * t, 0.0 * t + 0.1]))
