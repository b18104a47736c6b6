"""Where the files are that come with the program: experiments, towns and their missions."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from air_router.errors import UsageError

_HERE: Final = Path(__file__).parent
_PLANS: Final = _HERE / "plans"


class UnknownPlaceError(UsageError):
    """No shipped file has this name, and no file is there; `key` is the setting that names it."""

    def __init__(self, message: str, key: str = "") -> None:
        super().__init__(message)
        self.key = key


def experiment_names() -> list[str]:
    """The experiments that come with the program."""
    return sorted(path.stem for path in _PLANS.glob("*.yaml"))


def experiment_file(name: str) -> Path:
    """An experiment's file by its name or path. Raises UnknownPlaceError."""
    path = Path(name)
    if _is_word(name):
        shipped = _PLANS / f"{name}.yaml"
        if shipped.is_file():
            return shipped
        if not path.is_file():
            raise UnknownPlaceError(
                f"there is no experiment '{name}'; give a file, or one of "
                f"{', '.join(experiment_names())}"
            )
    return path


def town_file(name: str, folder: Path) -> Path:
    """A town's file by the name of a shipped one or a path from `folder`.

    Raises:
        UnknownPlaceError: there is none.
    """
    return _place(name, folder, "town")


def mission_file(name: str | None, town: Path, folder: Path) -> Path | None:
    """A mission's file by the name of a shipped one or a path from `folder`.

    Without a name it is the `mission.yaml` beside the town's file; None where there is none.

    Raises:
        UnknownPlaceError: there is none of this name.
    """
    if name is not None:
        return _place(name, folder, "mission")
    beside = town.with_name("mission.yaml")
    return beside if beside.is_file() else None


def _place(name: str, folder: Path, key: str) -> Path:
    if _is_word(name):
        for root in _missions():
            path = root / name / f"{key}.yaml"
            if path.is_file():
                return path
        names = {path.parent.name for root in _missions() for path in root.glob(f"*/{key}.yaml")}
        raise UnknownPlaceError(
            f"there is no {key} '{name}'; give a path, or one of {', '.join(sorted(names))}", key
        )
    path = folder / name
    if not path.is_file():
        raise UnknownPlaceError(f"there is no file {path}; correct the path", key)
    return path


def _missions() -> list[Path]:
    """Where missions are: in the installed package, or beside it in a checkout."""
    return [root for root in (_HERE / "missions", _HERE.parents[1] / "missions") if root.is_dir()]


def _is_word(name: str) -> bool:
    return "/" not in name and not name.endswith((".yaml", ".yml"))
