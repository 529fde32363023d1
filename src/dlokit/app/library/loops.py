"""Functions that run an event loop of their own, called where a loop may run already, as in a notebook."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def outside_any_loop(function: Callable[[], T], cancel: Callable[[], object]) -> T:
    """Call `function`; on another thread where an event loop runs on this one.

    Ctrl-C then calls `cancel`, which must make the function return soon; its result is returned.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return function()
    with ThreadPoolExecutor(1, thread_name_prefix="dlokit") as pool:
        future = pool.submit(function)
        try:
            return future.result()
        except KeyboardInterrupt:
            cancel()
            return future.result()
