"""What a page of HTML, its styles or Markdown load from another host."""

import re

_URL = r"((?:https?:|wss?:)?//[^\s\"'<>)]+)"
_LOADS = (
    # Links that a reader follows load nothing by themselves: `a`, and those that only name a page.
    rf"<(?!a\b)[a-z]+\b(?:(?!rel=\"?canonical)[^>])*?\s(?:src|srcset|href|xlink:href|data|poster|action)\s*=\s*[\"']?{_URL}",
    rf"@import\s+[\"']{_URL}",
    rf"\burl\(\s*[\"']?{_URL}",
    rf"\b(?:import|importScripts|fetch|WebSocket|EventSource)\(\s*[\"'`]{_URL}",
    rf"!\[[^\]]*\]\(\s*<?{_URL}",
)


def loaded_elsewhere(text: str) -> list[str]:
    """The addresses on other hosts from which `text` would have a browser load something, in no order."""
    return [match[1] for pattern in _LOADS for match in re.finditer(pattern, text)]
