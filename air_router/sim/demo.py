"""The mission that comes with the program: `air-router sim demo` needs no file of one's own."""

from importlib.resources import files
from pathlib import Path
from typing import Final

DEMO: Final = "demo"
"""What names it where a mission file is expected."""


def demo_or(mission: Path) -> Path:
    """The mission file that was named; for `demo`, where no such file is, the packaged one."""
    if str(mission) != DEMO or mission.exists():
        return mission
    room = Path(str(files("air_router.sim")))
    packaged = room / "demo"  # in a wheel; a checkout has it among its missions
    folder = packaged if packaged.is_dir() else room.parents[1] / "missions" / "pennovation"
    return folder / "mission.yaml"
