"""`import dlokit`: what it gives, and what it does not load."""

import subprocess
import sys

import pytest

import dlokit


def test_importing_loads_nothing_but_itself() -> None:
    script = "import sys; before = set(sys.modules); import dlokit; dir(dlokit); print(*(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not [name for name in loaded if name.startswith("dlokit.")]
    assert "numpy" not in loaded


@pytest.mark.parametrize("name", dlokit.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    public = getattr(dlokit, name)
    assert name == "__version__" or public.__doc__
    assert name in dir(dlokit)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"dlokit.*shapes"):
        _ = dlokit.shapes  # pyright: ignore[reportAttributeAccessIssue]
