"""The addresses of the viewer's page: each has a key in its path, without which nothing is served."""

import base64
import hashlib
import hmac
import secrets

KEY_BYTES = 24
EVERY_ADDRESS = ("0.0.0.0", "::")
"""Hosts that stand for all addresses of the machine."""
HTTP_PORT = 80
"""The port that browsers leave out of an address."""


def new_key() -> str:
    """A new random key, of characters that need no escape in a URL."""
    return secrets.token_urlsafe(KEY_BYTES)


def watch_key(key: str) -> str:
    """The key of pages that may look and not operate; `key`, which may do both, cannot be found from it."""
    digest = hmac.digest(key.encode(), b"watch", hashlib.sha256)
    return base64.urlsafe_b64encode(digest[:KEY_BYTES]).decode()


def page_url(host: str, port: int, key: str) -> str:
    """Where a browser on the viewer's machine opens the page that is served on `host`:`port` with `key`."""
    return f"http://{authority('localhost' if host in EVERY_ADDRESS else host, port)}/{key}"


def authority(host: str, port: int) -> str:
    """Host and port as a browser sends them in `Host`: IPv6 addresses in brackets, port 80 left out."""
    host = f"[{host}]" if ":" in host else host
    return host.lower() if port == HTTP_PORT else f"{host}:{port}".lower()
