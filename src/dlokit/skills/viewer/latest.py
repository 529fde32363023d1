"""The newest message of a topic, and whether it was drawn."""

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Fresh(Generic[T]):
    """Keeps one value until a newer one comes; hands each out once."""

    def __init__(self) -> None:
        self.value: T | None = None
        self.fresh = False

    def put(self, value: T) -> None:
        """A newer value."""
        self.value, self.fresh = value, True

    def again(self) -> None:
        """Hand the value out once more."""
        self.fresh = self.value is not None

    def take(self, use: Callable[[T], object]) -> bool:
        """Call `use` with the value when it is new; whether it was."""
        if not self.fresh or self.value is None:
            return False
        self.fresh = False
        use(self.value)
        return True
