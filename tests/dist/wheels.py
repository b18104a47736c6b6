"""Our wheels in environments of their own, elsewhere than in a checkout."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from tests.distributions import ROOT, ROVER

UV = shutil.which("uv", path=f"{Path(sys.executable).parent}:{os.environ.get('PATH', '')}")
LIMIT_S = 300
FOLDERS = {"air-router": ROOT, "mocha-link": ROVER}


def extras(distribution: str) -> set[str]:
    """The extras of a distribution, as its pyproject has them."""
    about = tomllib.loads((FOLDERS[distribution] / "pyproject.toml").read_text("utf-8"))
    return set(about["project"]["optional-dependencies"])


def built(folder: Path) -> dict[str, Path]:
    """The wheels of both distributions, built from this checkout."""
    for source in FOLDERS.values():
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(command, cwd=source, check=True, capture_output=True)
    return {name: next(folder.glob(f"{name.replace('-', '_')}-*.whl")) for name in FOLDERS}


class Environment:
    """A virtual environment with a distribution's wheel and what it needs, and an empty home."""

    def __init__(self, folder: Path, wheels: dict[str, Path], distribution: str) -> None:
        assert UV, "uv is not installed: make dist-test"
        self.home = folder / "home"
        self.home.mkdir(parents=True)
        self.bin = folder / "env" / "bin"
        self._pins = folder / "pins.txt"
        pins = re.findall(
            r"^\S+==[^\s;]+", (ROOT / "constraints.txt").read_text("utf-8"), re.MULTILINE
        )
        self._pins.write_text("\n".join(pins))
        self._uv("venv", "--python", sys.executable, str(folder / "env"))
        ours = wheels.values() if distribution == "air-router" else [wheels["mocha-link"]]
        self.install(*map(str, ours))

    def install(self, *what: str) -> None:
        """Install, in the versions that this checkout is tested with."""
        python = str(self.bin / "python")
        self._uv("pip", "install", "--python", python, "--constraint", str(self._pins), *what)

    @staticmethod
    def _uv(*arguments: str) -> None:
        command = [UV or "uv", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{shlex.join(command)}\n{done.stderr}"

    @property
    def variables(self) -> dict[str, str]:
        """Nothing of the checkout, and no home of the user."""
        kept = {name: os.environ[name] for name in ("PATH", "LANG", "TZ") if name in os.environ}
        return {**kept, "HOME": str(self.home), "XDG_STATE_HOME": str(self.home / "state")}

    def start(self, program: str, *arguments: object, **more) -> subprocess.Popen:
        """Start a program of the environment, in its home."""
        command = [str(self.bin / program), *map(str, arguments)]
        return subprocess.Popen(
            command,
            cwd=self.home,
            env=self.variables,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **more,
        )

    def run(self, program: str, *arguments: object, code: int = 0) -> subprocess.CompletedProcess:
        """Run it to its end; what it printed."""
        with self.start(program, *arguments) as process:
            try:
                out, errors = process.communicate(timeout=LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                raise
        assert process.returncode == code, f"{program} {arguments}\n{out[-4000:]}\n{errors[-4000:]}"
        return subprocess.CompletedProcess(process.args, process.returncode, out, errors)

    def install_as_printed(self, errors: str) -> None:
        """Run the command that a program printed because it lacks a package."""
        *_, command = re.findall(r"run: (pip install .*)", errors)  # what ended it is printed last
        _, _, *what = shlex.split(command)
        self.install(*what)
