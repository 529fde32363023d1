from dlokit import bench as bench
from dlokit.app.data.identify import Identified as Identified
from dlokit.app.data.identify import identify as identify
from dlokit.app.library.judging import judge as judge
from dlokit.app.library.recording import Recording as Recording
from dlokit.app.library.recording import open_run as open_run
from dlokit.app.library.run import Run as Run
from dlokit.app.library.shape import shape as shape
from dlokit.app.library.tracker import Nodes as Nodes
from dlokit.app.library.tracker import Tracker as Tracker
from dlokit.errors import DlokitError as DlokitError
from dlokit.errors import InputError as InputError

__all__ = [
    "DlokitError",
    "Identified",
    "InputError",
    "Nodes",
    "Recording",
    "Run",
    "Tracker",
    "__version__",
    "bench",
    "identify",
    "judge",
    "open_run",
    "shape",
]

__version__: str
