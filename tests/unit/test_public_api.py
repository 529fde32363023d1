"""`import dlokit`: what it gives."""

import inspect
import sys

import pytest

import dlokit


@pytest.mark.parametrize("name", dlokit.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    public = getattr(dlokit, name)
    assert name == "__version__" or public.__doc__
    assert name in dir(dlokit)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"dlokit.*shapes"):
        _ = dlokit.shapes  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    "function",
    [
        dlokit.Tracker,
        dlokit.Tracker.update,
        dlokit.bench.observers,
        dlokit.bench.shaping,
        dlokit.identify,
        dlokit.judge,
        dlokit.points_from_depth,
        dlokit.shape,
    ],
)
def test_help_names_the_types_instead_of_spelling_out_their_members(function: object) -> None:
    assert callable(function)
    assert "numpy._typing" not in str(inspect.signature(function))


def test_sources_that_are_not_installed_have_an_unknown_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [])
    assert dlokit.__version__ == "unknown"
