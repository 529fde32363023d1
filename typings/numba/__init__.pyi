"""The part of Numba that dlokit uses: a decorator that keeps the type of what it compiles."""

from collections.abc import Callable
from typing import TypeVar

_F = TypeVar("_F", bound=Callable[..., object])

def njit(
    *,
    cache: bool = False,
    fastmath: bool | set[str] = False,
    inline: str = "never",
    nogil: bool = False,
    error_model: str = "python",
) -> Callable[[_F], _F]: ...
