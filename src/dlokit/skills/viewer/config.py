"""Settings of the viewer."""

from dataclasses import dataclass
from typing import Annotated

import tyro
from msgspec import Meta

from dlokit.ranges import check_ranges


@dataclass(frozen=True, kw_only=True)
class ViewerConfig:
    """The browser viewer."""

    host: str = "127.0.0.1"
    """Address on which the page is served. With 0.0.0.0 other machines can open it as well; anyone with the page's key
    can command the robot."""
    port: Annotated[int, Meta(ge=0, le=65535), tyro.conf.arg(aliases=("--port",))] = 8080
    """TCP port of the viewer's page; 0 takes any free one."""

    def __post_init__(self) -> None:
        check_ranges(self, "viewer")
