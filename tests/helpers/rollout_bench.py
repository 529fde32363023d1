"""The strategy `rollout` on a bench: a rod that lies as an I and shall become an S, and a short search."""

from collections.abc import Callable

from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.rollout.candidates import PlanningScene
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

MODEL = BelievedDlo()
I_SHAPE = builtin_shape("I", MODEL.length_m, MODEL.nodes)
S_SHAPE = builtin_shape("S", MODEL.length_m, MODEL.nodes)
SHORT = SearchConfig(rollouts=70, finalists=2, generations=1)


def tools(reachable: Callable[[Pose], bool] = lambda T: True) -> PlanningTools:
    return PlanningTools(reachable=reachable, actions=ActionConfig(), model=MODEL)


def scene(goal: Float64Array = S_SHAPE, marked: tuple[int, ...] = ()) -> PlanningScene:
    return PlanningScene(I_SHAPE, goal, frozenset(marked), tools())
