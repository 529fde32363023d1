"""Where the viewer's page is."""

from dlokit.types.message import Message


class ViewerPage(Message, frozen=True, kw_only=True, eq=False):
    """The page is served from now on."""

    url: str
    """As a browser on the viewer's machine opens it, with the key without which nothing is served."""
