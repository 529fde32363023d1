"""Settings of the paper's strategy, of which there are hardly any."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.planning.base import ActionStrategy, PlanningTools


@dataclass(frozen=True, kw_only=True)
class FarthestConfig:
    """The paper's strategy: the node farthest from its goal is taken to it."""

    name: ClassVar[str] = "farthest"

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.planning.farthest import Farthest

        return Farthest(tools)


@dataclass(frozen=True, kw_only=True)
class FarthestTangentConfig:
    """As farthest, but only with nodes that the gripper can turn all the way to the goal's tangent."""

    name: ClassVar[str] = "farthest-tangent"

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.planning.farthest import Farthest

        return Farthest(tools, whole_turn=True)
