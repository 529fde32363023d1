"""Settings of the strategy `rollout`: of its search, and of what an action is judged by."""

from dataclasses import dataclass, field
from typing import ClassVar

from dlokit.errors import ConfigError
from dlokit.rod.believed import GRAVITY_M_S2, ModelConfig
from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.types.action import Action, Drag, LayDown, Push

_LEAST = 16  # rollouts besides those of the finalists


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """How many rollouts, and for what."""

    rollouts: int = 480
    """Motions played through for one decision, at most."""
    seconds: float = 2.0
    """Time for one decision when live [s]: the search ends with what it has then. On a machine so busy that not a
    quarter of the rollouts fits, it takes longer, up to three times. Not looked at in lockstep."""
    generations: int = 8
    """Refinements."""
    finalists: int = 8
    """Candidates that are tried on other rods."""
    doubt: float = 1.4
    """Factor by which friction and stiffness of the DLO may be other than the model's, up or down, at least; more
    where the model is less sure of them (`--model.belief`, and what was learnt). 1: the model is believed."""
    astray_m: float = 0.003
    """Distance by which the DLO may lie beside where it is seen [m]. Every finalist is played on eight rods: each pair
    of friction and stiffness, on either side of where it is seen."""
    timestep_s: float = 0.01
    """Step of the quick rod [s]."""
    threads: int = 0
    """Threads that play; 0: one a core. The result is the same."""

    def __post_init__(self) -> None:
        if self.finalists < 1 or self.generations < 0 or self.threads < 0:
            raise ConfigError(
                f"a search has finalists {self.finalists}, generations {self.generations}, threads {self.threads}; "
                f"at least 1, 0 and 0 are allowed."
            )
        finals = self.finalists * self.other_rods
        if self.rollouts < _LEAST + finals:
            raise ConfigError(
                f"a search of {self.rollouts} rollouts is too short: {self.finalists} finalists take {finals}, and "
                f"{_LEAST} more are needed; allow more rollouts."
            )
        if not self.seconds > 0.0:
            raise ConfigError(f"a search has seconds {self.seconds}; it must be a number above 0.")
        if not (self.doubt >= 1.0 and 0.0 < self.timestep_s <= 0.02):
            raise ConfigError(
                f"a search has doubt {self.doubt} and timestep_s {self.timestep_s}; the doubt is a factor of 1 or "
                f"more, the time step above 0 and up to 0.02 s."
            )

    @property
    def other_rods(self) -> int:
        """Rods besides the model's that each finalist is tried on, as `doubtful_rods` makes them."""
        return 0 if self.doubt == 1.0 else 8


@dataclass(frozen=True, kw_only=True)
class ScoreConfig:
    """What an action is judged by."""

    next_action: float = 0.5
    """Weight of the error that one more ideal pick-and-place would leave, beside the error itself."""
    reach_m: float = 0.08
    """Distance along the rod over which a pick-and-place takes its neighbours with it [m]."""
    clearance_m: float = 0.04
    """Strands that are no neighbours on the rod stay this far apart after an action [m]."""
    goal_share: float = 0.7
    """A goal whose strands are closer asks for no more than this share of its own clearance."""
    pick_place_miss_m: float = 0.003
    """How far a pick-and-place usually ends from what is predicted, whatever the doubt [m]; adds to its RMSE."""
    drag_miss_m: float = 0.0015
    """The same for a drag [m]."""
    push_miss_m: float = 0.005
    """The same for a push, which holds nothing [m]."""
    lay_down_miss_m: float = 0.008
    """The same for a lay-down of a DLO that drapes [m]: near the goal it is not worth its time."""
    drapes_share: float = 0.1
    """Gravity bending length (EI / w)^(1/3) over length, up to which a DLO drapes as it is laid down. The miss of a
    lay-down grows with the square of what is above it: a wire turns in the fingers, and lands where it likes."""
    caution: float = 1.0
    """Standard deviations, over rods that the DLO may be, by which an action must be better."""

    def miss_m(self, kind: type[Action], model: ModelConfig) -> float:
        """How far a kind of action usually ends from what is predicted, with a DLO as the model has it [m]."""
        if kind is LayDown:
            bending_m = (model.bending_stiffness_n_m2 / (GRAVITY_M_S2 * model.mass_kg_m)) ** (1.0 / 3.0)
            return self.lay_down_miss_m * max(1.0, bending_m / (self.drapes_share * model.length_m)) ** 2
        of_kind: dict[type[Action], float] = {Drag: self.drag_miss_m, Push: self.push_miss_m}
        return of_kind.get(kind, self.pick_place_miss_m)


@dataclass(frozen=True, kw_only=True)
class RolloutConfig:
    """Candidates of every kind are played through in the model; the one that leaves least to be done is taken."""

    name: ClassVar[str] = "rollout"

    search: SearchConfig = field(default_factory=SearchConfig)
    """How many rollouts, and for what."""
    score: ScoreConfig = field(default_factory=ScoreConfig)
    """What an action is judged by."""
    pick_place: bool = True
    """Consider pick-and-place."""
    drag: bool = True
    """Consider dragging the rod along the table."""
    lay_down: bool = True
    """Consider laying the whole rod down along the goal."""
    push: bool = False
    """Consider pushing the rod sideways with closed fingers. Off, as where the rod goes then is less well predicted."""
    pair: bool = True
    """Consider pairs of grasps, where there are two arms."""
    seed: int = 0
    """Seed of the candidates, with the stamp of the shape; the same question has the same answer."""

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.planning.rollout.strategy import Rollout

        return Rollout(self, tools)

    def load(self) -> float:
        """Compile and load the rod that candidates are played with; the seconds that took."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.rod.rollout import warm

        return warm()
