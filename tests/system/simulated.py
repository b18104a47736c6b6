"""A simulated PX4 in a thread of ours: `sitl vehicle`, and no other Python to start for it."""

import argparse
import contextlib
import threading

from sitl.cli.vehicle_command import add_arguments, process_of


@contextlib.contextmanager
def simulated_vehicle(*words):
    """Runs what `sitl vehicle` runs with these words; gives the `VehicleProcess`."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    stop = threading.Event()
    with process_of(parser.parse_args([str(word) for word in words])) as process:
        thread = threading.Thread(target=process.run, args=(stop.is_set,), name="vehicle")
        thread.start()
        try:
            yield process
        finally:
            stop.set()
            thread.join()
