"""Finding, starting and stopping a PX4: a stand-in for it, and a real one where there is one."""

import contextlib
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from sitl.cli import cli
from sitl.process import px4_process
from sitl.process.px4_install import NoPx4Error, Px4Install, find_px4
from sitl.process.px4_process import (
    PortsInUseError,
    Px4Error,
    Px4Process,
    Px4Settings,
    environment,
)
from sitl.px4sim.state import StartPosition

HOME = StartPosition(40.4406, -79.9959, 280.0)
LISTING = "image ls --format {{.Tag}} px4io/px4-sitl"
LIMIT_S = 60

# Sends on the gimbal's port what PX4 sends: first that it cannot arm yet, then that it can.
STAND_IN = """\
#!{python}
import json, os, socket, sys, time
from pymavlink.dialects.v20 import common as mavlink
instance = int(sys.argv[sys.argv.index("-i") + 1])
with open({seen!r}, "w") as seen:
    known = {{n: v for n, v in os.environ.items() if n.startswith("PX4_")}}
    first = os.environ["PATH"].partition(os.pathsep)[0]
    started = {{"variables": known, "first": first, "process": os.getpid()}}
    json.dump({{"arguments": sys.argv[1:], **started}}, seen)
print("hello from the stand-in", flush=True)
if {fails}:
    sys.exit(7)
end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender = mavlink.MAVLink(None, instance + 1, 1)
for status in [0] * 3 + [3] * 1000:
    beat = sender.heartbeat_encode(2, 12, 0, 0, status).pack(sender)
    end.sendto(beat, ("127.0.0.1", 13280 + instance))
    time.sleep(0.05)
"""


@pytest.fixture
def free_instance():
    """One whose ports are free, and which no test beside this one takes before it ends."""
    for instance in range(100, 140):  # 140's first port is 100's second
        held = Path(tempfile.gettempdir()) / f"air-router-px4-{instance}"
        with contextlib.suppress(BlockingIOError, PortsInUseError), held.open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield px4_process._free_instance(instance)
            return
    pytest.fail("no instance is free")


@pytest.fixture
def build(tmp_path):
    """A build folder with a stand-in for PX4; `make(fails, old)` writes it."""

    def make(*, fails=False, old=False):
        root = tmp_path / "PX4"
        program = root / "build" / "px4_sitl_default" / "bin" / "px4"
        program.parent.mkdir(parents=True, exist_ok=True)
        start_files = program.parent.parent / "etc" / "init.d-posix"
        start_files.mkdir(parents=True, exist_ok=True)
        reads = "" if old else 'case "$name" in "PX4_PARAM_"*) ;; esac'
        (start_files / "rcS").write_text(reads)
        seen = str(tmp_path / "seen.json")
        program.write_text(STAND_IN.format(python=sys.executable, seen=seen, fails=fails))
        program.chmod(0o755)
        return root

    return make


def seen(tmp_path):
    return json.loads((tmp_path / "seen.json").read_text())


def gone(process_id):
    end_s = time.monotonic() + LIMIT_S
    while time.monotonic() < end_s:
        try:
            os.kill(process_id, 0)
        except ProcessLookupError:
            return True
        os.sched_yield()
    return False


class TestFinding:
    def test_a_source_tree_a_build_folder_and_an_executable(self, build):
        root = build()
        folder = root / "build" / "px4_sitl_default"
        for place in (root, folder, folder / "bin" / "px4"):
            install = find_px4(str(place), {})
            assert install == Px4Install(folder / "bin" / "px4", folder / "etc")
        command = install.command(3, root, {})
        assert command[1:4] == ["-d", "-i", "3"]
        assert command[-1] == str(folder / "etc")

    def test_the_environment_and_the_path(self, build, tmp_path):
        program = build() / "build" / "px4_sitl_default" / "bin" / "px4"
        assert find_px4(None, {"PX4_SITL": str(program)}).description == str(program)
        assert find_px4(None, {"PATH": str(program.parent)}).description == str(program)
        several = os.pathsep.join((str(program), "/another/px4"))
        assert find_px4(None, {"PX4_SITL": several}).description == str(program)
        alone = tmp_path / "alone" / "px4"
        alone.parent.mkdir()
        alone.symlink_to("/bin/true")
        found = find_px4(None, {"PATH": str(alone.parent)})
        assert found.command(0, tmp_path, {}) == [str(alone), "-d", "-i", "0"]

    def test_the_official_package(self, build, tmp_path):
        """The .deb has /opt/px4 and a link to its program on the PATH."""
        folder = build() / "build" / "px4_sitl_default"
        (tmp_path / "usr").mkdir()
        (tmp_path / "usr" / "px4").symlink_to(folder / "bin" / "px4")
        found = find_px4(None, {"PATH": str(tmp_path / "usr")})
        command = found.command(0, tmp_path, {})
        assert (command[0], command[-1]) == (str(folder / "bin" / "px4"), str(folder / "etc"))

    def runtime(self, folder, name, *tags):
        """A container runtime that lists an image with these tags."""
        program = folder / name
        lines = "\n".join(tags)
        program.write_text(f"#!/bin/sh\n[ \"$*\" = '{LISTING}' ] && echo '{lines}'\n")
        program.chmod(0o755)
        return {"PATH": str(folder)}

    def test_a_container(self, tmp_path):
        environment = self.runtime(tmp_path, "podman", "v1.18.0", "v1.17.0", "<none>")
        install = find_px4(None, environment)
        assert install.description == "podman image px4io/px4-sitl:v1.18.0"
        command = install.command(2, tmp_path, {"PX4_HOME_LAT": "1.5"})
        assert command[:2] == [str(tmp_path / "podman"), "run"]
        assert "PX4_HOME_LAT=1.5" in command
        assert command[-4:] == ["px4io/px4-sitl:v1.18.0", "-d", "-i", "2"]
        assert install.stop_command()[-1] in command
        assert find_px4("podman", environment) == install

    def test_a_container_of_a_version(self, tmp_path):
        environment = self.runtime(tmp_path, "docker", "v1.18.0", "latest", "v1.17.0")
        for wanted, tag in (("docker", "latest"), ("docker:v1.17.0", "v1.17.0")):
            assert find_px4(wanted, environment).image == f"px4io/px4-sitl:{tag}"
        with pytest.raises(NoPx4Error, match=r"px4-sitl:v1.16.0; it has v1.18.0, latest, v1.17.0"):
            find_px4("docker:v1.16.0", environment)

    def test_a_container_runtime_without_the_image(self, tmp_path):
        environment = self.runtime(tmp_path, "docker")
        for wanted in (None, "docker"):
            with pytest.raises(NoPx4Error, match=r"docker has no image px4io/px4-sitl"):
                find_px4(wanted, environment)

    def test_a_container_runtime_that_may_not_be_used(self, tmp_path):
        (tmp_path / "docker").symlink_to("/bin/false")
        with pytest.raises(NoPx4Error, match=r"docker lists no images \(no message\)"):
            find_px4("docker", {"PATH": str(tmp_path)})

    @pytest.mark.parametrize("wanted", [None, "docker", "/no/such/place"])
    def test_none_reports_what_to_install(self, wanted, tmp_path):
        with pytest.raises(NoPx4Error, match="docker pull px4io/px4-sitl") as raised:
            find_px4(wanted, {"PATH": str(tmp_path)})
        assert "PX4-Autopilot/releases" in str(raised.value)
        assert raised.value.exit_code == 4

    def test_a_folder_without_px4(self, tmp_path):
        with pytest.raises(NoPx4Error, match="no bin/px4 "):
            find_px4(str(tmp_path), {})


class TestProcess:
    def test_it_is_started_with_home_speed_and_parameters(self, build, tmp_path, free_instance):
        settings = Px4Settings(HOME, 5.0, {"GF_ACTION": 3}, free_instance, tmp_path / "files")
        with Px4Process(find_px4(str(build()), {}), settings) as process:
            assert process.wait_until_armable(timeout_s=LIMIT_S)
            assert process.running
            number = seen(tmp_path)["process"]
            assert number == process.process_id
        assert not process.running
        variables = seen(tmp_path)["variables"]
        assert variables["PX4_HOME_LAT"] == "40.4406"
        assert variables["PX4_SIM_SPEED_FACTOR"] == "5"
        assert variables["PX4_PARAM_GF_ACTION"] == "3"
        assert variables["PX4_SIM_MODEL"] == "sihsim_quadx"
        assert "hello from the stand-in" in (tmp_path / "files" / "px4.log").read_text()
        assert gone(number)

    def test_before_1_16_the_start_script_gets_degrees_and_parameters_from_a_script_of_ours(
        self, build, tmp_path, free_instance
    ):
        """It takes PX4_HOME_* for parameters in 1e-7 degrees: it stood 8753 km away."""
        files = tmp_path / "files"
        settings = Px4Settings(HOME, 5.0, {"SIM_BAT_DRAIN": 1350.5}, free_instance, files)
        with Px4Process(find_px4(str(build(old=True)), {}), settings) as process:
            assert process.wait_until_armable(timeout_s=LIMIT_S)
        started = seen(tmp_path)
        assert sorted(started["variables"]) == [
            *("PX4_SIMULATOR", "PX4_SIM_MODEL", "PX4_SIM_SPEED_FACTOR")
        ]
        assert started["first"] == str(files)  # where its start script looks first
        script = (files / "px4-rc.params").read_text()
        assert script.splitlines() == [
            "param set SIH_LOC_LAT0 404406000",
            "param set SIH_LOC_LON0 -799959000",
            "param set SIH_LOC_H0 280.0",
            "param set SIM_BAT_DRAIN 1350.5",
        ]

    def test_one_that_ends_reports_why(self, build, free_instance):
        settings = Px4Settings(HOME, instance=free_instance)
        with (
            Px4Process(find_px4(str(build(fails=True)), {}), settings) as process,
            pytest.raises(Px4Error, match=r"code 7(?s:.)*hello from the stand-in"),
        ):
            process.wait_until_armable(timeout_s=LIMIT_S)

    def test_waiting_has_an_end(self, build, free_instance):
        settings = Px4Settings(HOME, instance=free_instance)
        with Px4Process(find_px4(str(build()), {}), settings) as process:
            assert not process.wait_until_armable(lambda: True)
            with pytest.raises(Px4Error, match="cannot arm"):
                process.wait_until_armable(timeout_s=0.0)

    def test_an_instance_that_has_just_begun_elsewhere(
        self, build, free_instance, tmp_path, monkeypatch
    ):
        monkeypatch.setattr("sitl.process.px4_process._LOCK", str(tmp_path / "lock"))
        holds = "import fcntl, sys; f = open(sys.argv[1], 'w'); fcntl.lockf(f, fcntl.LOCK_EX);"
        holds += "print(flush=True); sys.stdin.read()"
        with subprocess.Popen(
            [sys.executable, "-c", holds, str(tmp_path / f"lock-{free_instance}")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        ) as holder:
            holder.stdout.readline()
            with pytest.raises(PortsInUseError, match="runs already"):
                Px4Process(build, Px4Settings(HOME, instance=free_instance))

    def test_a_taken_instance(self, build, free_instance):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 18570 + free_instance))
            with pytest.raises(PortsInUseError, match="another --instance"):
                Px4Process(find_px4(str(build()), {}), Px4Settings(HOME, instance=free_instance))

    def test_a_taken_instance_that_conversations_were_to_have(self, build, free_instance, capsys):
        command = "conform", "--px4", str(build()), "--instance", str(free_instance)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 18570 + free_instance))
            assert cli.main([*command, "same-plan-again"]) == 4
        assert f"instance {free_instance} runs already" in capsys.readouterr().err

    def test_a_parameter_that_would_be_shell(self):
        with pytest.raises(Px4Error, match="not the name of a PX4 parameter"):
            environment(Px4Settings(HOME, parameters={"A;rm": 1}))


class TestCommand:
    def start(self, build, free_instance):
        return subprocess.Popen(
            [
                *(sys.executable, "-m", "sitl", "px4", "--home", "40.4406,-79.9959,280"),
                *("--px4", str(build()), "--instance", str(free_instance), "--speed", "5"),
                *("--param", "GF_ACTION=1"),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )

    def test_ready_line_and_end(self, build, tmp_path, free_instance):
        with self.start(build, free_instance) as process:
            ready = json.loads(process.stdout.readline())
            process.send_signal(signal.SIGTERM)
            assert process.wait(LIMIT_S) == 0
        assert ready["ready"] is True
        assert ready["system_id"] == free_instance + 1
        assert ready["truth"] == f"udp://127.0.0.1:{19410 + free_instance}"
        assert seen(tmp_path)["variables"]["PX4_PARAM_GF_ACTION"] == "1"
        assert seen(tmp_path)["variables"]["PX4_PARAM_SIM_BAT_DRAIN"] == "1350"
        assert gone(ready["process_id"])

    def test_killed_it_takes_px4_with_it(self, build, free_instance):
        with self.start(build, free_instance) as process:
            ready = json.loads(process.stdout.readline())
            process.kill()
            process.wait(LIMIT_S)
            assert gone(ready["process_id"])

    def test_a_px4_that_dies_is_reported(self, build, free_instance):
        with self.start(build, free_instance) as process:
            ready = json.loads(process.stdout.readline())
            os.kill(ready["process_id"], signal.SIGKILL)
            assert process.wait(LIMIT_S) == 4

    def test_none_found(self, capsys, monkeypatch, tmp_path):
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.delenv("PX4_SITL", raising=False)
        assert cli.main(["px4"]) == 4
        assert "Install one of these" in capsys.readouterr().err


@pytest.fixture
def real_px4():
    try:
        install = find_px4()
    except NoPx4Error as error:
        pytest.skip(str(error).splitlines()[0])
    return install


class TestRealPx4:
    @pytest.mark.timeout(240)
    def test_it_holds_to_the_recorded_conversations(self, real_px4, capsys):
        names = ("arm-twice", "mission-upload-and-download", "goto-into-a-zone", "landing")
        code = cli.main(["conform", *names, "--px4", "--speed", "5", "--json"])
        printed = capsys.readouterr()
        assert code == 0, printed.err
        held = {row["name"]: row["held"] for row in json.loads(printed.out)}
        assert set(names) <= set(held)
        assert all(held.values())
