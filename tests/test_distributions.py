"""The two distributions: what is in them, what they need, how large a rover's installation is."""

import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import air_router
import air_router.cli.cli
import mocha_link
import mocha_link.cli.cli
from mocha_link.cli import options_of
from tests.command_lines import context_of
from tests.distributions import ROOT, ROVER, needed, project


def test_all_have_one_version():
    assert air_router.__version__ == mocha_link.__version__
    for each in (ROOT, ROVER):
        assert "version" in project(each)["dynamic"]
        text = (each / "pyproject.toml").read_text(encoding="utf-8")
        path = tomllib.loads(text)["tool"]["hatch"]["version"]["path"]
        assert (each / path).resolve() == ROOT / "mocha_link" / "__init__.py"
    major, minor, _ = mocha_link.__version__.split(".", 2)
    below = f"<{major}.{int(minor) + 1}"
    (bound,) = (each for each in project(ROOT)["dependencies"] if each.startswith("mocha-link"))
    assert bound.endswith(below)  # wheels of one minor version belong together


def build(target, source, folder):
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (built,) = folder.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return built


def names_in(wheel):
    return set(zipfile.ZipFile(wheel).namelist())


@pytest.fixture(scope="module")
def rover_wheel(tmp_path_factory):
    return build("wheel", ROVER, tmp_path_factory.mktemp("wheel"))


def test_the_wheel_of_mocha_link_takes_no_other_name(rover_wheel):
    folders = {name.split("/")[0] for name in names_in(rover_wheel)}
    assert folders == {"mocha_link", f"mocha_link-{mocha_link.__version__}.dist-info"}


def test_its_source_archive_makes_the_same_wheel(rover_wheel, tmp_path):
    archive = build("sdist", ROVER, tmp_path)
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, filter="data")
    again = build("wheel", archive.with_suffix("").with_suffix(""), tmp_path / "again")
    assert names_in(again) == names_in(rover_wheel)


def test_the_wheel_of_air_router_leaves_mocha_link_to_it(tmp_path):
    folders = {name.split("/")[0] for name in names_in(build("wheel", ROOT, tmp_path))}
    assert {name for name in folders if "." not in name} == {"air_router", "geo", "sitl"}


def test_a_rover_installs_less_than_30_mb(rover_wheel):
    found = needed(project(ROVER)["dependencies"])
    assert {"numpy", "pymavlink", "mavsdk", "shapely"}.isdisjoint(found)
    ours = sum(each.file_size for each in zipfile.ZipFile(rover_wheel).infolist())
    theirs = sum(
        path.locate().stat().st_size
        for distribution in found.values()
        for path in distribution.files
        if path.locate().exists()
    )
    assert ours + theirs < 30e6


def test_only_simulator_and_radios_import_pymavlink():
    importing = {
        path.relative_to(ROOT).parts[0]
        for package in ("air_router", "geo", "mocha_link", "sitl")
        for path in (ROOT / package).rglob("*.py")
        if "import pymavlink" in (text := path.read_text("utf-8")) or "from pymavlink" in text
    }
    assert importing == {"sitl"}


SERVICES = sorted((ROOT / "packaging" / "systemd").glob("*.service"))
PROGRAMS = {
    "air-router": air_router.cli.cli.PROGRAM,
    "mocha-link": mocha_link.cli.cli.PROGRAM,
}


@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.stem)
@pytest.mark.parametrize("signed", [False, True])
def test_a_service_starts_what_our_programs_take(path, signed):
    settings = (path.parent / "flight.env").read_text(encoding="utf-8")
    if signed:
        (option,) = re.findall(r"^# If PX4 has a key .*: (--.*)$", settings, re.MULTILINE)
        settings = settings.replace("\nSIGNING=\n", f"\nSIGNING={option}\n")
    settings = settings.splitlines()
    text = path.read_text(encoding="utf-8")
    for name, value in (line.split("=", 1) for line in settings if not line.startswith("#")):
        text = text.replace(f"${{{name}}}", value).replace(f" ${name}", f" {value}")
    (command,) = re.findall(r"^ExecStart=/opt/air-router/bin/(.*)$", text, re.MULTILINE)
    program, *arguments = shlex.split(command)
    options = options_of(context_of(PROGRAMS[program], arguments))
    assert "$" not in command
    assert bool(getattr(options, "signing_key", None)) is (signed and program == "air-router")
    assert getattr(options, "resume", None) in {None, "resume" in path.stem}
    assert not getattr(options, "arm", False)  # that is the pilot's


HARDENED = {
    "NoNewPrivileges": "yes",
    "CapabilityBoundingSet": "",
    "ProtectSystem": "strict",
    "ProtectHome": "yes",
    "PrivateTmp": "yes",
    "RestrictSUIDSGID": "yes",
    "RestrictNamespaces": "yes",
    "SystemCallFilter": "@system-service",
}


@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.stem)
def test_a_service_can_write_little_and_gain_nothing(path):
    text = path.read_text(encoding="utf-8")
    settings = dict(re.findall(r"^(\w+)=(.*)$", text, re.MULTILINE))
    assert settings.items() >= HARDENED.items()
    assert re.fullmatch(r"\d+[MG]", settings["MemoryMax"])
    assert int(settings["TasksMax"]) > 0
    written = re.findall(r"/var/lib/([\w-]+)/", settings["ExecStart"])
    assert set(written) == {settings["StateDirectory"]}
    opened = re.findall(r"ipc:///run/([\w-]+)/", settings["ExecStart"])
    assert set(opened) == {settings["RuntimeDirectory"]}


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.stem)
def test_systemd_knows_every_setting_of_a_service_and_finds_it_little_exposed(path, tmp_path):
    unit = tmp_path / path.name.replace("@", "@io")
    text = path.read_text(encoding="utf-8")
    unit.write_text(text.replace("/opt/air-router/bin/", f"{Path(sys.executable).parent}/"))
    most = "--threshold=25"  # of 100
    for what in (("verify", "--man=no"), ("security", "--offline=true", "--no-pager", most)):
        found = subprocess.run(
            ["systemd-analyze", *what, str(unit)], capture_output=True, text=True, check=False
        )
        assert found.returncode == 0, found.stdout + found.stderr
        assert "Unknown" not in found.stderr


def test_containers_are_made_from_an_image_that_a_release_can_name_by_its_digest():
    text = (ROOT / "packaging" / "Dockerfile").read_text(encoding="utf-8")
    (default,) = re.findall(r"^ARG PYTHON_IMAGE=(\S+)$", text, re.MULTILINE)
    assert re.fullmatch(r"python:3\.\d+-slim-\w+(@sha256:[0-9a-f]{64})?", default)
    stages = re.findall(r"^FROM (\S+) AS (\S+)$", text, re.MULTILINE)
    made = {name for _, name in stages} | {"${PYTHON_IMAGE}"}
    assert {image for image, _ in stages} <= made  # no other image from elsewhere


def test_nodes_of_several_robots_on_one_computer_share_no_endpoint():
    text = (SERVICES[-1].parent / "mocha-link@.service").read_text(encoding="utf-8")
    served = re.findall(r"(?:ipc|tcp)://\S+", text)
    assert len(served) == 2
    assert all("%i" in endpoint for endpoint in served)
    assert "\nRuntimeDirectoryPreserve=yes\n" in text  # one that stops leaves the others' sockets


def test_containers_run_as_an_ordinary_user_and_copy_what_exists():
    text = (ROOT / "packaging" / "Dockerfile").read_text(encoding="utf-8")
    images = {name: part for part in text.split("\nFROM ")[1:] for name in [part.split()[2]]}
    for name in ("companion", "simulation"):
        assert "\nUSER 1000\n" in images[name]
    for source in re.findall(r"^COPY (?!--from)(.*) \S+$", text, re.MULTILINE):
        assert all((ROOT / each).exists() for each in source.split())
