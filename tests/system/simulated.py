"""A simulated PX4 in a thread of ours: `sitl vehicle`, and no other Python to start for it."""

import contextlib
import threading

from sitl.cli.vehicle_command import process_of, run
from sitl.rehearsal.scenario import RATES_HZ, STEP_S
from tests.command_lines import options_for


@contextlib.contextmanager
def simulated_vehicle(*arguments):
    """Runs what `sitl vehicle` runs with these arguments; gives the `VehicleProcess`.

    It moves in half as many steps, and streams only what a companion listens to.
    """
    stop = threading.Event()
    options = options_for(run, *arguments)
    with process_of(options, step_s=STEP_S, onboard_rates_hz=RATES_HZ) as process:
        thread = threading.Thread(target=process.run, args=(stop.is_set,), name="vehicle")
        thread.start()
        try:
            yield process
        finally:
            stop.set()
            thread.join()
