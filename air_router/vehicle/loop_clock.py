"""The companion's own clock where an event loop has one: all waits and ages are measured on it."""

import asyncio
import time


def loop_s() -> float:
    """Seconds on the running event loop's clock, `time.monotonic` on an ordinary one.

    A rehearsal flies on a loop whose clock is simulated time. Without a running loop (on another
    thread, or before the flight) it is `time.monotonic`.
    """
    try:
        return asyncio.get_running_loop().time()
    except RuntimeError:
        return time.monotonic()
