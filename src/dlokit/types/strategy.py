"""A strategy as it travels over the bus."""

from dlokit.types.message import Value


class StrategySpec(Value, frozen=True, kw_only=True, eq=False):
    """A strategy by its name, with its settings encoded; the component that has it decodes them."""

    name: str
    """As its package registers it, e.g. ``"brightness"``."""
    settings: bytes = b"{}"
    """The settings as a JSON object; what is left out has its default."""
