"""Where heavy work goes: inline in lockstep, to a pool of processes when live."""

from collections.abc import Callable
from typing import ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class Compute(Protocol):
    """Runs a pure, picklable function of ours somewhere."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        ...


class InlineCompute:
    """Here and now; the virtual clock stands still meanwhile."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        return function(*args, **kwargs)
