"""A flight as its operator has it: a terminal to type at, and a relay that knows what passed."""

import contextlib
import os
import pty

from air_router.sim.ports import free_port
from sitl.rehearsal.programs.relay import LossyRelay, Weather, wait_until
from tests.system.conftest import LIMIT_S, hurry
from tests.system.simulated import simulated_vehicle
from tests.system.test_hostile_flight import without_relays

DRAWN = "  - {name: drawn, circle: {centre: [39.94260, -75.20030], radius_m: 3}}\n"


def draw_zone(mission):
    text = mission.read_text(encoding="utf-8")
    mission.write_text(text.replace("no_fly_zones:\n", f"no_fly_zones:\n{DRAWN}"), "utf-8")


class Operated:
    """A flight whose operator types at a terminal, and the relay between it and a vehicle.

    Args:
        start: Starts programs, as `command` does.
        folder: For mission and records.
        more: Of `air-router fly`.
        speed: The vehicle's, times real time; None: there is no vehicle.
        weather: What becomes of what passes.
    """

    def __init__(self, start, folder, *more, speed=None, weather=None):
        self.mission = hurry(folder / "mission")
        without_relays(self.mission.with_name("team.yaml"))
        self.logs = folder / "logs"
        port = free_port()
        self.relay = LossyRelay(port, 0)
        self.relay.weather = weather or Weather()
        self._keyboard, terminal = pty.openpty()
        self.program = start(
            *("air-router", "fly", self.mission, f"--connect=udpin://127.0.0.1:{port}", "--json"),
            *(f"--log-dir={self.logs}", *more),
            stdin=terminal,
        )
        os.close(terminal)
        self._vehicle = contextlib.nullcontext()
        if speed is not None:
            self._vehicle = simulated_vehicle(
                *(self.mission, f"--speed={speed}", "--no-gcs"),
                f"--api-to=127.0.0.1:{self.relay.api_port}",
                f"--truth-to=127.0.0.1:{self.relay.truth_port}",
            )

    def __enter__(self):
        self.relay.__enter__()
        self._vehicle.__enter__()
        return self

    def __exit__(self, *_):
        self._vehicle.__exit__(None, None, None)
        self.relay.__exit__()
        os.close(self._keyboard)

    def type(self, line):
        os.write(self._keyboard, f"{line}\n".encode())

    def passed(self, name, **fields):
        """Messages of a kind that were sent, by whomever."""
        return [
            message
            for message in tuple(self.relay.recording.messages)
            if message.name == name and fields.items() <= message.fields.items()
        ]

    def wait_for(self, name, **fields):
        """Wait until such a message was sent; all of them."""
        came = wait_until(lambda: self.passed(name, **fields), LIMIT_S)
        assert came, f"no {name}: {self.program.printed}"
        return self.passed(name, **fields)
