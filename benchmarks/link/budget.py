"""Cores to go round: so many contacts take place at once as the machine can serve.

Between contacts no node needs a core, so dozens of links are emulated at once; but a node that
waits for a core while its link is up loses what the link would have carried.
"""

import contextlib
import os
from collections.abc import Iterator
from multiprocessing.context import BaseContext

SHARE = 0.75  # of the cores; the rest is for the system and for what we estimate too low

# Cores for the two nodes and the emulator together while a link is up, by its rate: about twice
# of what they were seen to take (`cores` in --json), because they want them at once.
_NEEDS = {0.25e6: 0.06, 1e6: 0.1, 10e6: 0.3}
_OTHER_NEEDS = {("new", 10e6): 0.6, ("tcp", 10e6): 0.15}


class Budget:
    """Shared by processes that are forked after it was made; served in the order of requests."""

    def __init__(self, context: BaseContext, cores: float | None = None) -> None:
        self.cores = cores or SHARE * (os.cpu_count() or 1)
        self._turn = context.Lock()
        self._freed = context.Condition()
        self._used = context.Value("d", 0.0, lock=False)

    @contextlib.contextmanager
    def use(self, cores: float) -> Iterator[None]:
        """Wait until so many cores are free, and hold them meanwhile."""
        cores = min(cores, self.cores)
        with self._turn, self._freed:
            while self._used.value + cores > self.cores + 1e-6:
                self._freed.wait()
            self._used.value += cores
        try:
            yield
        finally:
            with self._freed:
                self._used.value -= cores
                self._freed.notify_all()


def needs(way: str, rate_bit_s: float) -> float:
    return _OTHER_NEEDS.get((way, rate_bit_s)) or _NEEDS.get(rate_bit_s, max(_NEEDS.values()))
