"""The file of a flight's record: its name, and the facts that it begins with."""

import platform
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Final

from air_router.record.log_file import FORMAT, LogFile

LIBRARIES: Final = ("air-router", "mavsdk", "networkx", "numpy", "pyproj", "pyzmq", "shapely")


def open_record(
    folder: Path, names: tuple[str, str], mission: str, trouble: Callable[[str], None]
) -> LogFile:
    """A new file in a folder, which is made when it is not there.

    Args:
        folder: Where the file goes.
        names: How its name begins, and ends: the UAV's.
        mission: The path of the mission, as the operator wrote it.
        trouble: Told when nothing more can be recorded.

    Raises:
        OSError: it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    facts = {
        "format": FORMAT,
        "mission": mission,
        "unix_s": repr(time.time()),
        "python": platform.python_version(),
        "system": platform.platform(),
        **{name: _version(name) for name in LIBRARIES},
    }
    words = [names[0], time.strftime("%Y%m%dT%H%M%SZ", time.gmtime()), _tame(names[1])]
    stem = "-".join(word for word in words if word)
    number = 1
    while True:
        name = f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap"
        try:
            return LogFile(folder / name, trouble, facts)
        except FileExistsError:
            number += 1


def no_folder(error: OSError) -> OSError:
    """Why nothing can be recorded in the folder that the operator named, and what to do."""
    advice = "name a folder that can be written to, --log-dir D, or say --no-record"
    return OSError(error.errno, f"{error.strerror}; {advice}", error.filename)


def _tame(name: str) -> str:
    """A name of a robot as a part of a file's name."""
    return "".join(c if c.isalnum() else "_" for c in name)[:40]


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
