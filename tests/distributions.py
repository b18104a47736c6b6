"""What a distribution of ours needs, as in its pyproject and as in the development set-up."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROVER = ROOT / "packaging" / "mocha-link"


def project(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def needed(requirements):
    """The distributions that these requirements lead to, without extras."""
    found, waiting = {}, [*requirements]
    while waiting:
        requirement, _, marker = waiting.pop().partition(";")
        name = re.match(r"[\w.-]+", requirement)[0]
        if name in found or "extra" in marker or "python_version <" in marker:
            continue
        found[name] = metadata.distribution(name)
        waiting += found[name].requires or ()
    return found


def only_mocha_link(folder):
    """A folder to import from: `mocha_link` and its dependencies, nothing else."""
    folder.mkdir()
    (folder / "mocha_link").symlink_to(ROOT / "mocha_link")
    for distribution in needed(project(ROVER)["dependencies"]).values():
        for name in {path.parts[0] for path in distribution.files} - {"..", "__pycache__"}:
            (folder / name).symlink_to(distribution.locate_file(name))
    return folder
