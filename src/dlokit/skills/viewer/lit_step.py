"""Which box of the flow chart is lit."""

from collections.abc import Sequence

from dlokit.skills.viewer.flow_chart import Edge
from dlokit.types.flow import FlowStatus


class LitStep:
    """The box that was entered last. Reports that name no box of the chart, as the closing one, leave it lit."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self._boxes = {name for source, _, target in edges for name in (source, target)}
        self.step = ""
        self.last_outcome = ""

    def record(self, status: FlowStatus) -> None:
        """Take in a report of the flow."""
        if status.step in self._boxes:
            self.step, self.last_outcome = status.step, status.last_outcome
