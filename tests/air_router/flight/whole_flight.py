"""A whole flight on a pretended vehicle, as fast as it computes."""

import asyncio
import io

from air_router.flight.flight import Flight
from air_router.flight.terminal import StatusLine
from air_router.gossip.mapper import Mapper
from air_router.record.recorder import Recorder
from air_router.vehicle.clock import VehicleClock
from tests.air_router.alone import Alone


async def at_once(function, *arguments):
    """Stands for `asyncio.to_thread`: the pretended vehicle's time stands still meanwhile."""
    return function(*arguments)


class WholeFlight:
    """The flight program with a vehicle, a node, a record and a screen of its own."""

    def __init__(self, mission, vehicle_class, log_dir, *, arm=True, resume=False):
        wall_s = iter(range(10**9))
        self.clock = VehicleClock(monotonic=lambda: next(wall_s) * 1e-6, unix=lambda: 1.7e9)
        self.vehicle = vehicle_class(mission, self.clock)
        self.gossip = Alone()
        self.out = io.StringIO()
        self.recorder = Recorder(log_dir, "mission.yaml")
        self.flight = Flight(
            mission,
            self.vehicle,
            clock=self.clock,
            gossip=self.gossip,
            mapper=Mapper(mission),
            seek=("callisto",),
            recorder=self.recorder,
            status=StatusLine(self.out),
            arm=arm,
            resume=resume,
        )

    def run(self):
        with self.recorder:
            return asyncio.run(self._ends())

    async def _ends(self):
        """The flight's result; one that does not end by itself is an error."""
        flight = asyncio.ensure_future(self.flight.run())
        self.vehicle.lasts_too_long = flight.cancel
        await asyncio.wait({flight})
        assert not flight.cancelled(), f"it does not end: {self.out.getvalue()[-300:]}"
        return flight.result()
