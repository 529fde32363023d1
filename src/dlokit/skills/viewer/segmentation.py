"""Settings of the segmentation that a user changes on the page: what they find in the picture, and the calls."""

import asyncio
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import tomli_w

from dlokit.communication.container import end_tasks
from dlokit.communication.port import Port
from dlokit.communication.skill import Skill
from dlokit.communication.strategies import StrategyKind
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.scene import Scene
from dlokit.errors import ConfigError, SkillFailure
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.viewer.panel.health import ComponentHealth
from dlokit.skills.viewer.state import Received
from dlokit.types.flow import RunPhase
from dlokit.types.image import CameraPictures, SegmentedPicture
from dlokit.types.observation import LookResult
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.system import StrategyProposal, StrategySpec

PREVIEW_WIDTH_PX = 640
"""Width of the picture with its mask [px]: a thin DLO must be hit with the mouse."""
_BETWEEN_S = 0.15
"""Wait between two previews, and between two calls, while a slider is dragged [s]."""

Settings = Any
"""The settings of a strategy: a frozen dataclass."""


@dataclass(frozen=True, kw_only=True)
class SegmentationTools:
    """What the page needs to change the segmentation of a run."""

    kind: StrategyKind[Any]
    """The installed segmentations."""
    configured: Settings
    """Those of the run."""
    set_segmentation: Skill[[StrategySpec], None]
    look: Skill[[], LookResult] | None
    """Takes a picture where the run waits and does not look itself; None: pictures arrive always."""
    preview: Callable[[CameraPictures, tuple[PosedArm, ...], Settings, int], SegmentedPicture]
    """What settings find in pictures, at most so many pixels wide. Picklable."""
    propose: Callable[[CameraPictures, tuple[int, int], Settings], StrategyProposal]
    """The settings that a click proposes, at a column and a row [px] of the rectified picture. Picklable."""
    group: str = "perception.segmentation"
    """Path of the settings on the command line."""
    has_file: bool = True
    """Whether a configuration file has a table of that name."""


class SegmentationTuner:
    """Changes the segmentation by calls, one at a time, and computes what it finds in the newest picture.

    Its methods are called on the loop.
    """

    def __init__(self, tools: SegmentationTools, seen: Received, scene: Scene, port: Callable[[], Port]) -> None:
        """`port` is known once the component runs."""
        self.tools = tools
        self._seen, self._port = seen, port
        self._models = {mount.robot: mount.model for mount in scene.arms}
        self._first = scene.arms[0].model
        self.settings: Settings = tools.configured
        """The newest valid settings; perception has them, or they are on the way to it."""
        self._accepted: Settings = tools.configured
        self._calling: asyncio.Task[None] | None = None
        self._computing: asyncio.Task[None] | None = None
        self._previewed: tuple[CameraPictures, Settings] | None = None
        self._clicked: tuple[int, int] | None = None
        self._restarts = 0
        self.picture: SegmentedPicture | None = None
        """What the settings find in the newest picture; None before there is one."""
        self.size_px = (0, 0)
        """Width and height of the picture that a click refers to."""
        self.notice = ""
        """What became of the last change, where the user must know it."""
        self.moved = 0
        """Number of changes that did not come from the sliders, which therefore must follow."""

    @property
    def names(self) -> tuple[str, ...]:
        """The installed segmentations."""
        return tuple(self.tools.kind.installed())

    def change(self, values: Mapping[str, float]) -> None:
        """Use other values of the present strategy's settings."""
        try:
            self.settings, self.notice = dataclasses.replace(self.settings, **values), ""
        except (ConfigError, ValueError, TypeError) as error:  # the last two: the checks of another package's settings
            self.notice = str(error)
            return
        self._call()

    def choose(self, name: str) -> None:
        """Use another strategy, with its settings of the run's start, or its defaults."""
        configured = self.tools.configured
        self._use(configured if name == configured.name else self.tools.kind.installed()[name]())

    def reset(self) -> None:
        """Use the settings of the run's start again."""
        self._use(self.tools.configured)

    def click(self, pixel: tuple[int, int]) -> None:
        """Use the settings that the picture around a pixel (column, row) proposes, at the next `show`."""
        self._clicked = pixel

    def show(self) -> None:
        """Compute what the settings find in the newest picture, unless that is known; called again and again."""
        if (chosen := self._seen.segmentation.value) is not None and self._seen.segmentation.is_new:
            self._seen.segmentation.is_new = False
            if self._calling is None:  # another program's call, or that of a page before a restart
                self.settings = self._accepted = self.tools.kind.from_spec(chosen.spec)
                self.moved += 1
        images = self._seen.pictures.value
        if images is None or self._computing is not None:
            return
        known, clicked = self._previewed, self._clicked
        if known is not None and clicked is not None:
            self._clicked = None
            self._computing = asyncio.create_task(self._propose(known[0], clicked), name="proposal")
        elif known is None or known[0] is not images or known[1] != self.settings:
            self._computing = asyncio.create_task(self._preview(images, self.settings), name="segmentation preview")

    def on_health(self, states: Sequence[ComponentHealth]) -> None:
        """Call again after a restart of perception, which begins with the settings of the run's start."""
        restarts = sum(each.restarts for each in states if each.component.name == self.tools.set_segmentation.component)
        again = restarts > self._restarts and self._accepted != self.tools.configured
        self._restarts = restarts
        if again:
            self._accepted = self.tools.configured
            self._call()

    async def close(self) -> None:
        """End all calls and computations."""
        await end_tasks(*(task for task in (self._calling, self._computing) if task is not None))

    def _use(self, settings: Settings) -> None:
        self.settings, self.notice = settings, ""
        self.moved += 1
        self._call()

    def _call(self) -> None:
        if self._calling is None:
            self._calling = asyncio.create_task(self._calls(), name="segmentation")

    async def _calls(self) -> None:
        """Call until perception has the newest settings: while a slider is dragged, one call follows the other."""
        tools, port = self.tools, self._port()
        try:
            while self.settings != self._accepted:
                wanted = self.settings
                outcome = await port.call(tools.set_segmentation, tools.kind.to_spec(wanted))
                if not isinstance(outcome, Succeeded):
                    why = outcome.detail if isinstance(outcome, Failed | Rejected) else outcome.why
                    self.settings, self.notice = self._accepted, f"The segmentation was not changed: {why}."
                    self.moved += 1
                    return
                self._accepted = wanted
                await LoopClock().sleep(_BETWEEN_S)
            if tools.look is not None and self._seen.run.phase is RunPhase.WAITING:
                await port.call(tools.look)  # the cloud of the new settings; the page shows why there is none
        finally:
            self._calling = None

    async def _preview(self, images: CameraPictures, settings: Settings) -> None:
        try:
            self.picture = await self._port().compute(
                self.tools.preview, images, self._posed(), settings, PREVIEW_WIDTH_PX
            )
            self._previewed = images, settings
            self.size_px = images.calibration.width_px, images.calibration.height_px
            await LoopClock().sleep(_BETWEEN_S)
        except SkillFailure as failure:
            self.notice = f"The mask cannot be computed: {failure.detail}."
        finally:
            self._computing = None

    async def _propose(self, images: CameraPictures, pixel: tuple[int, int]) -> None:
        try:
            proposal = await self._port().compute(self.tools.propose, images, pixel, self.settings)
        except (SkillFailure, ValueError) as error:
            self.notice = f"Nothing is proposed: {error}."
            return
        finally:
            self._computing = None
        if proposal.spec is not None:
            self._use(self.tools.kind.from_spec(proposal.spec))
        self.notice = proposal.text

    def _posed(self) -> tuple[PosedArm, ...]:
        """The arms where they were last seen; a moving one is a picture's time away from its outline."""
        newest = [robot.value for robot in self._seen.robots.values()]
        return tuple(PosedArm(self._models.get(state.robot, self._first), state) for state in newest if state)


def changed(settings: Settings) -> dict[str, Any]:
    """The settings that differ from the strategy's defaults, by name."""
    defaults = type(settings)()
    names = [each.name for each in dataclasses.fields(settings)]
    return {name: getattr(settings, name) for name in names if getattr(settings, name) != getattr(defaults, name)}


def flags(settings: Settings, group: str) -> str:
    """The options of the command line that begin a run with these settings; `group` is their path."""
    options = [f"--segmentation {settings.name}"]
    for name, value in changed(settings).items():
        option = name.replace("_", "-")
        text = str(int(value) if isinstance(value, float) and value.is_integer() else value)
        no, text = ("", f" {text}") if not isinstance(value, bool) else ("" if value else "no-", "")
        options.append(f"--{group}.{no}{option}{text}")
    return " ".join(options)


def table(settings: Settings, group: str) -> str:
    """The lines of a configuration file for these settings; `group` is the name of their table."""
    return f"[{group}]\n" + tomli_w.dumps({"kind": settings.name, **changed(settings)})
