"""A serial cable between two programs: two pseudo-terminals, so many baud, and noise."""

import contextlib
import os
import random
import select
import threading
import time
import tty

from pymavlink.dialects.v20 import common as mavlink

BITS = 10  # of a byte on the wire, with start and stop
KEPT_BYTES = 4096  # of what is written faster than it is taken; the rest is dropped
TURN_S = 0.005
BURST_S = 0.05


class SerialCable:
    """Both ends are devices that any program can open.

    Args:
        baud: Each way.
        noise: Share of the pieces that lose a byte.

    Attributes:
        ends: Paths of the two devices.
        carried: Bytes each way, from either end.
    """

    def __init__(self, baud, noise=0.0):
        self._stop = threading.Event()
        pairs = [os.openpty() for _ in range(2)]
        for pair in pairs:
            for each in pair:
                tty.setraw(each)
        self.ends = [os.ttyname(device) for _, device in pairs]
        self.carried = [0, 0]
        self._open = [each for pair in pairs for each in pair]
        masters = [master for master, _ in pairs]
        ways = [(0, *masters), (1, *reversed(masters))]
        self._threads = [
            threading.Thread(target=self._carry, args=(*way, baud / BITS, noise)) for way in ways
        ]
        for thread in self._threads:
            thread.start()

    def close(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for each in self._open:
            os.close(each)

    def _carry(self, way, source, drain, bytes_per_s, noise):
        dice, waiting = random.Random(way), bytearray()
        at_s, allowed = time.monotonic(), 0.0
        while not self._stop.is_set():
            if select.select([source], [], [], TURN_S)[0]:
                waiting += os.read(source, KEPT_BYTES)[: KEPT_BYTES - len(waiting)]
            now_s = time.monotonic()
            allowed = min(allowed + (now_s - at_s) * bytes_per_s, BURST_S * bytes_per_s)
            at_s = now_s
            piece = bytes(waiting[: int(allowed)])
            del waiting[: len(piece)]
            allowed -= len(piece)
            self.carried[way] += len(piece)
            if piece and dice.random() < noise:
                piece = piece[1:]
            with contextlib.suppress(BlockingIOError):
                os.write(drain, piece)


@contextlib.contextmanager
def plugged_into(bound, device):
    """A vehicle that sends datagrams to a socket uses a serial device instead."""
    stop, to = threading.Event(), []
    port = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    bound.settimeout(TURN_S)

    def down():
        while not stop.is_set():
            with contextlib.suppress(TimeoutError, BlockingIOError):
                datagram, source = bound.recvfrom(65535)
                to[:] = [source]
                os.write(port, datagram)

    def up():
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while not stop.is_set():
            if select.select([port], [], [], TURN_S)[0]:
                for message in parser.parse_buffer(os.read(port, 4096)) or ():
                    if to and message.get_type() != "BAD_DATA":
                        bound.sendto(message.get_msgbuf(), to[0])

    threads = [threading.Thread(target=down), threading.Thread(target=up)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()
        os.close(port)
