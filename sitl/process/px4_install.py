"""Where a PX4 SITL is on this machine: a build folder, a `px4` on the PATH, or a container."""

import os
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from air_router.errors import NoVehicleError

ENVIRONMENT: Final = "PX4_SITL"
"""The environment variable that names a build folder, a source tree or a `px4` executable; or
several, separated as on the PATH, of which the first is taken."""

IMAGE: Final = "px4io/px4-sitl"
"""The official container image of PX4 with its built-in simulator; tags are PX4's: v1.17.0."""

_ANSWER_S: Final = 10.0
_RUNTIMES: Final = ("docker", "podman")
_BUILDS: Final = ("build/px4_sitl_default", "build/px4_sitl_sih", ".")
_RC_NAME: Final = "init.d-posix/rcS"
_RC: Final = f"etc/{_RC_NAME}"

WHAT_TO_INSTALL: Final = f"""\
Install one of these and try again:
  * the px4 package (about 10 MB, Ubuntu) from https://github.com/PX4/PX4-Autopilot/releases
  * Docker or Podman, and: docker pull {IMAGE}:v1.17.0
  * PX4's source, built with `make px4_sitl`; give its folder with --px4 DIR or {ENVIRONMENT}=DIR
docs/simulation.md has each step by step."""


class NoPx4Error(NoVehicleError):
    """There is no PX4 SITL on this machine; the message has what to install.

    Attributes:
        reason: Why none was found.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}\n{WHAT_TO_INSTALL}")
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Px4Install:
    """A PX4 that can be started: an executable, or the official container image.

    Attributes:
        program: The executable, or the container runtime.
        etc: The files that an executable starts from, where they are known.
        container: What the container is to be called; empty: it is an executable.
        tag: The image's.
    """

    program: Path
    etc: Path | None = None
    container: str = ""
    tag: str = ""

    @property
    def description(self) -> str:
        """Its kind and its place."""
        return f"{self.program.name} image {self.image}" if self.container else str(self.program)

    @property
    def image(self) -> str:
        """The container image, if it is one."""
        return f"{IMAGE}:{self.tag}"

    @property
    def takes_variables(self) -> bool:
        """Whether its start script takes parameters and a home in degrees (from PX4 1.16 on).

        An older one copies PX4_HOME_LAT and PX4_HOME_LON, unchanged, to parameters in 1e-7
        degrees, and reads neither PX4_HOME_ALT nor PX4_PARAM_*.
        """
        return self.etc is None or "PX4_PARAM_" in (self.etc / _RC_NAME).read_text(errors="replace")

    def command(self, instance: int, folder: Path, environment: Mapping[str, str]) -> list[str]:
        """Program and arguments; a container shares this machine's network.

        Args:
            instance: PX4's, 0 or more.
            folder: Where it may write; there it is started, too.
            environment: PX4_* variables; those of the process are the caller's business.
        """
        if self.container:
            arguments = [str(self.program), "run", "--rm", "--init", "--network", "host"]
            arguments += ["--name", self.container]
            for name, value in sorted(environment.items()):
                arguments += ["--env", f"{name}={value}"]
            return [*arguments, self.image, "-d", *(["-i", str(instance)] if instance else [])]
        arguments = [str(self.program), "-d", "-i", str(instance)]
        if self.etc is not None:
            arguments += ["-w", str(folder), "-s", _RC, str(self.etc)]
        return arguments

    def stop_command(self) -> list[str] | None:
        """A program that ends it, where a signal to the first one does not."""
        return (
            [str(self.program), "stop", "--time", "3", self.container] if self.container else None
        )


def find_px4(
    requested: str | None = None, environment: Mapping[str, str] | None = None
) -> Px4Install:
    """Find a PX4 SITL.

    Args:
        requested: A build folder, a source tree, an executable, or `docker` or `podman`, with a tag
            of the image behind a colon if there are several; None reads the environment variable
            PX4_SITL, then on the PATH, then for a container runtime.
        environment: The process's, if None.

    Raises:
        NoPx4Error: there is none.
    """
    environment = os.environ if environment is None else environment
    path = environment.get("PATH")
    requested = requested or next(iter(named(environment)), None)
    if requested and requested.partition(":")[0] in _RUNTIMES:
        return _contained(requested, path)
    if requested:
        return _built(Path(requested))
    program = shutil.which("px4", path=path)
    if program is not None:
        return _built(Path(program))
    reasons = [f"{ENVIRONMENT} is not set", "there is no `px4` on the PATH"]
    for name in _RUNTIMES:
        try:
            return _contained(name, path)
        except NoPx4Error as error:
            reasons.append(error.reason)
    raise NoPx4Error(f"no PX4 simulator found: {'; '.join(reasons)}.")


def named(environment: Mapping[str, str]) -> list[str]:
    """What the environment variable PX4_SITL names: none, one or several."""
    value = environment.get(ENVIRONMENT, "")
    if value.partition(":")[0] in _RUNTIMES:
        return [value]
    return [place for place in value.split(os.pathsep) if place]


def _built(path: Path) -> Px4Install:
    if path.is_dir():
        for build in _BUILDS:
            program = path / build / "bin" / "px4"
            if program.is_file():
                return Px4Install(program.resolve(), _etc(program))
        raise NoPx4Error(f"{path}: no bin/px4 in there, nor in its build folder.")
    if not path.is_file() or not os.access(path, os.X_OK):
        raise NoPx4Error(f"{path}: no such folder or executable.")
    etc = _etc(path)  # PX4 searches for its tools beside the path that it was started by: no link
    return Px4Install(path.absolute() if etc is None else path.resolve(), etc)


def _etc(program: Path) -> Path | None:
    """The start files beside an executable's folder: `bin/px4` goes with `etc`."""
    root = program.resolve().parent.parent
    return root / "etc" if (root / _RC).is_file() else None


def _contained(requested: str, path: str | None) -> Px4Install:
    """A runtime that has the image; nothing is downloaded without a request."""
    name, _, tag = requested.partition(":")
    runtime = shutil.which(name, path=path)
    if runtime is None:
        raise NoPx4Error(f"no {name} on the PATH")
    try:
        done = subprocess.run(  # noqa: S603 - the user's own container runtime
            [runtime, "image", "ls", "--format", "{{.Tag}}", IMAGE],
            check=False,
            capture_output=True,
            text=True,
            timeout=_ANSWER_S,
        )
    except (OSError, subprocess.TimeoutExpired):
        raise NoPx4Error(f"{name} does not respond") from None
    if done.returncode != 0:
        detail = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise NoPx4Error(f"{name} lists no images ({detail})")
    tags = [each for each in done.stdout.split() if each != "<none>"]  # the newest first
    if not tags or (tag and tag not in tags):
        there = f"; it has {', '.join(tags)}" if tags else ""
        wanted = f"{IMAGE}:{tag}" if tag else IMAGE
        raise NoPx4Error(f"{name} has no image {wanted}{there}")
    found = tag or ("latest" if "latest" in tags else tags[0])
    return Px4Install(Path(runtime), container=f"air-router-px4-{os.getpid()}", tag=found)
