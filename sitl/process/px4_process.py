"""A real PX4 SITL as a child process: started, waited for, and stopped for certain."""

import contextlib
import fcntl
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from air_router.errors import NoVehicleError
from air_router.sim import is_free
from mocha_link.lifetime import Closeable
from mocha_link.path_safety import made_folder, new_file
from sitl.mavlink import frames
from sitl.process.end_with_parent import ending_with_us
from sitl.process.px4_install import Px4Install
from sitl.px4sim import StartPosition

_LOCK: Final = "/tmp/px4_lock"  # noqa: S108 - PX4's own
_STANDBY: Final = 3  # HEARTBEAT.system_status: it can arm
_AUTOPILOT: Final = 1
_STOP_S: Final = 5.0
_READY_S: Final = 60.0
_LARGEST: Final = 65535
_MOST_INSTANCES: Final = 10
_PORTS: Final = (14580, 14540, 18570, 19450, 19410, 13030, 13280, 14280)  # of instance 0
_LAST_LINES: Final = 12
_SET: Final = "PX4_PARAM_"  # sets a parameter of the name that follows
_OWN_PARAMETERS: Final = "px4-rc.params"
"""A script with parameters of one's own, which PX4's start script searches for on the PATH."""

AIRFRAMES: Final = ("quadx", "hex")
"""The multicopters of PX4's built-in simulator; it has a hexarotor from 1.17 on."""

_PARAMETER: Final = re.compile(r"[A-Z][A-Z0-9_]{1,15}\Z")


class Px4Error(NoVehicleError):
    """PX4 did not start, or stopped; the message has its last output."""


class PortsInUseError(NoVehicleError):
    """The ports of PX4's instances are taken."""


@dataclass(frozen=True, slots=True)
class Px4Settings:
    """How PX4 is started.

    Attributes:
        place: Home.
        speed: Times real time.
        parameters: Values that differ from its defaults.
        instance: Ports + N, system id N + 1; None: the first that is free.
        folder: Where its log and files go; None: a folder that is removed at the end.
        airframe: One of `AIRFRAMES`.
    """

    place: StartPosition
    speed: float = 1.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    instance: int | None = None
    folder: Path | None = None
    airframe: str = AIRFRAMES[0]


class Px4Process(Closeable):
    """Runs a PX4 SITL with its built-in simulator; a context manager that ends it.

    It also ends when this process is killed.

    Args:
        install: Which PX4.
        settings: How.

    Attributes:
        instance: PX4's instance number.
        log: Its output.

    Raises:
        PortsInUseError: no instance is free, or the wanted one is not.
    """

    def __init__(self, install: Px4Install, settings: Px4Settings) -> None:
        self._install = install
        self.instance = _free_instance(settings.instance)
        self._temporary = tempfile.TemporaryDirectory(prefix="px4-", ignore_cleanup_errors=True)
        folder = (settings.folder or Path(self._temporary.name)).absolute()
        made_folder(folder, private=True)  # PX4 writes more files there, and follows links
        self.log = folder / "px4.log"
        inherited, variables = _inherited(), environment(settings)
        if not install.takes_variables:
            variables, script = before_1_16(variables)
            with new_file(folder / _OWN_PARAMETERS) as file:
                file.write(script.encode())
            inherited["PATH"] = os.pathsep.join([str(folder), inherited.get("PATH", os.defpath)])
        command = install.command(self.instance, folder, variables)
        with new_file(self.log) as log:
            self._process = subprocess.Popen(  # noqa: S603 - what the user installed
                ending_with_us(*command),
                cwd=folder,
                env={**inherited, **variables, "PYTHONPATH": os.pathsep.join(sys.path)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C is for us: we end it
            )

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def process_id(self) -> int:
        """Of PX4."""
        return self._process.pid

    def wait_until_armable(
        self, stopped: Callable[[], bool] = lambda: False, timeout_s: float = _READY_S
    ) -> bool:
        """Wait until PX4's health and arming checks pass.

        It listens on the gimbal's port and sends nothing, so that the API link's first partner is
        the autopilot flies.

        Args:
            stopped: Ends the waiting.
            timeout_s: Of real time.

        Returns:
            False if `stopped` was true.

        Raises:
            Px4Error: it ended, or cannot arm in time.
        """
        deadline_s = time.monotonic() + timeout_s
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
            ear.bind(("127.0.0.1", 13280 + self.instance))
            ear.settimeout(0.2)
            while not stopped():
                if not self.running:
                    raise Px4Error(
                        f"PX4 ended with code {self._process.returncode}; {self.last_output()}"
                    )
                if time.monotonic() > deadline_s:
                    raise Px4Error(f"PX4 cannot arm after {timeout_s:.0f} s; {self.last_output()}")
                with contextlib.suppress(TimeoutError):
                    if _can_arm(ear.recv(_LARGEST)):
                        return True
        return False

    def close(self) -> None:
        """End it and wait until it has ended; does nothing the second time."""
        stop_command = self._install.stop_command()
        if self.running and stop_command is not None:
            subprocess.run(stop_command, check=False, capture_output=True)  # noqa: S603
        for number, patience_s in ((signal.SIGTERM, _STOP_S), (signal.SIGKILL, None)):
            if not self.running:
                break
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(patience_s)
        self._temporary.cleanup()

    def last_output(self) -> str:
        """Its last output, for an error message."""
        lines = self.log.read_text(errors="replace").splitlines()[-_LAST_LINES:]
        return "its last output:\n  " + "\n  ".join(lines) if lines else "it printed nothing"


def environment(settings: Px4Settings) -> dict[str, str]:
    """The variables that PX4's start script reads.

    Raises:
        Px4Error: a parameter's name is none.
    """
    place = settings.place
    variables = {
        "PX4_SIM_MODEL": f"sihsim_{settings.airframe}",
        "PX4_SIMULATOR": "sihsim",
        "PX4_HOME_LAT": repr(place.latitude_deg),
        "PX4_HOME_LON": repr(place.longitude_deg),
        "PX4_HOME_ALT": repr(place.altitude_m),
        "PX4_SIM_SPEED_FACTOR": f"{settings.speed:g}",
    }
    for name, value in settings.parameters.items():
        if not _PARAMETER.match(name):
            raise Px4Error(f"'{name}' is not the name of a PX4 parameter")
        variables[f"{_SET}{name}"] = f"{value:g}"
    return variables


def before_1_16(variables: Mapping[str, str]) -> tuple[dict[str, str], str]:
    """The variables that a start script before PX4 1.16 reads, and a script that sets the others.

    Its simulator has the place where it starts in parameters: 1e-7 degrees, and metres.

    Args:
        variables: Those of `environment`.
    """
    left = dict(variables)
    latitude_deg, longitude_deg = (float(left.pop(f"PX4_HOME_{axis}")) for axis in ("LAT", "LON"))
    values = {
        "SIH_LOC_LAT0": str(round(latitude_deg * 1e7)),
        "SIH_LOC_LON0": str(round(longitude_deg * 1e7)),
        "SIH_LOC_H0": left.pop("PX4_HOME_ALT"),
    }
    for name in [each for each in left if each.startswith(_SET)]:
        values[name.removeprefix(_SET)] = left.pop(name)
    return left, "".join(f"param set {name} {value}\n" for name, value in values.items())


def _inherited() -> dict[str, str]:
    """This process's environment without what would make PX4 start as something else."""
    dropped = ("PX4_", "ROS_DOMAIN_ID")
    return {name: value for name, value in os.environ.items() if not name.startswith(dropped)}


def _free_instance(wanted: int | None) -> int:
    """An instance whose ports are free; PX4's own lock files are checked, too."""
    instances = range(_MOST_INSTANCES) if wanted is None else (wanted,)
    for instance in instances:
        ends = ((socket.SOCK_DGRAM, "127.0.0.1", first + instance) for first in _PORTS)
        if not _is_locked(instance) and all(is_free(*end) for end in ends):
            return instance
    what = "PX4's instances 0 to 9 run" if wanted is None else f"instance {wanted} runs"
    raise PortsInUseError(
        f"{what} already, or something else has their UDP ports (14580 + N ...); end one of them"
        + ("" if wanted is None else ", or take another --instance")
    )


def _is_locked(instance: int) -> bool:
    """Whether a PX4 has this instance, also one that has just begun and listens nowhere yet."""
    try:
        with Path(f"{_LOCK}-{instance}").open("r+b") as file:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until it is closed
    except BlockingIOError:
        return True
    except OSError:  # mostly: there is no such file
        return False
    return False


def _can_arm(datagram: bytes) -> bool:
    return any(
        frame.fields()["system_status"] >= _STANDBY
        for frame in frames(datagram)
        if frame.name == "HEARTBEAT" and frame.component_id == _AUTOPILOT
    )
