"""A simulated PX4 in a thread of ours: `sitl vehicle`, and no other Python to start for it."""

import argparse
import contextlib
import threading

from sitl.cli.vehicle_command import add_arguments, process_of
from sitl.rehearsal.scenario import RATES_HZ, STEP_S


@contextlib.contextmanager
def simulated_vehicle(*words):
    """Runs what `sitl vehicle` runs with these words; gives the `VehicleProcess`.

    It moves in half as many steps, and streams only what a companion listens to.
    """
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    stop = threading.Event()
    arguments = parser.parse_args([str(word) for word in words])
    with process_of(arguments, step_s=STEP_S, onboard_rates_hz=RATES_HZ) as process:
        thread = threading.Thread(target=process.run, args=(stop.is_set,), name="vehicle")
        thread.start()
        try:
            yield process
        finally:
            stop.set()
            thread.join()
