from dlokit import bench as bench
from dlokit.app.library.live import System as System
from dlokit.app.library.live import live as live
from dlokit.app.library.recording import Recording as Recording
from dlokit.app.library.recording import open_run as open_run
from dlokit.app.library.run import Run as Run
from dlokit.app.library.shape import judge as judge
from dlokit.app.library.shape import shape as shape
from dlokit.app.library.tracker import Nodes as Nodes
from dlokit.app.library.tracker import Tracker as Tracker
from dlokit.app.library.tracker import points_from_depth as points_from_depth
from dlokit.errors import DlokitError as DlokitError
from dlokit.errors import InputError as InputError
from dlokit.errors import SkillFailure as SkillFailure
from dlokit.errors import SkillRejected as SkillRejected
from dlokit.extras.identification.identify import Identified as Identified
from dlokit.extras.identification.identify import identify as identify

__all__ = [
    "DlokitError",
    "Identified",
    "InputError",
    "Nodes",
    "Recording",
    "Run",
    "SkillFailure",
    "SkillRejected",
    "System",
    "Tracker",
    "__version__",
    "bench",
    "identify",
    "judge",
    "live",
    "open_run",
    "points_from_depth",
    "shape",
]

__version__: str
