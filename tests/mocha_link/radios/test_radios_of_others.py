"""A radio of another package: an entry point of the group `mocha_link.radios`."""

import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from mocha_link.errors import RadioError
from mocha_link.radios import OURS, open_radio
from mocha_link.team import RADIO_GROUP, DocumentError, RadioUrl, installed_radios

ROOT = Path(__file__).parents[3]
RADIO = """
from mocha_link import Reading, Unit

class Silvus:
    def __init__(self, url, team, robot):
        self.made_of = url, team, robot

    def start(self, report):
        report(self.made_of[2].peers[0], Reading(14.0, Unit.SNR_DB, "silvus"))

    def close(self):
        pass

def broken(url, team, robot):
    raise KeyError("no such thing")

def none(url, team, robot):
    return object()
"""


@pytest.fixture
def register(tmp_path, monkeypatch):
    """Installs a package whose radios are these functions, by scheme."""
    installed_radios.registered.cache_clear()

    def install(**radios):
        info = tmp_path / "of_others-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: of-others\nVersion: 1\n")
        lines = [f"{scheme} = radio_of_others:{name}" for scheme, name in radios.items()]
        (info / "entry_points.txt").write_text("\n".join([f"[{RADIO_GROUP}]", *lines]))
        (tmp_path / "radio_of_others.py").write_text(RADIO)
        monkeypatch.syspath_prepend(tmp_path)

    yield install
    installed_radios.registered.cache_clear()


def test_its_url_stands_in_a_team_file_and_it_reports(register, team):
    register(silvus="Silvus")
    url = "silvus://10.0.0.9:80/streaming?antenna=2&user=x"
    team = team.with_robots({"io": {"radio": url}})
    radio = open_radio(url, team, "io")
    parsed, given_team, robot = radio.made_of
    assert (parsed.scheme, parsed.host, parsed.port) == ("silvus", "10.0.0.9", 80)
    assert parsed.options == {"antenna": "2", "user": "x"}
    assert str(parsed) == url
    assert (given_team, robot) == (team, team.robot("io"))
    reports = []
    radio.start(lambda peer, reading: reports.append((peer, str(reading))))
    assert reports == [("callisto", "14 dB (silvus)")]


def test_it_takes_the_place_of_none_of_ours(register, team):
    register(udp="Silvus")
    assert type(open_radio("udp://127.0.0.1:0", team, "io")).__name__ == "UdpRadio"


@pytest.mark.parametrize(
    ("function", "why"),
    [
        ("broken", "KeyError: 'no such thing'"),
        ("none", "object has no method start"),
        ("missing", "AttributeError: "),
    ],
)
def test_one_that_is_broken_is_reported_with_its_package(register, team, function, why):
    register(silvus=function)
    with pytest.raises(
        RadioError, match=f"'silvus:' of the package 'of-others' is broken: .*{why}"
    ):
        open_radio("silvus:", team, "io")


def test_an_unknown_radio_names_those_that_are_installed(register, team):
    register(silvus="Silvus")
    with pytest.raises(RadioError, match=r"is no radio; write udp://host:port.*, silvus:\.\.\."):
        RadioUrl.parse("silvos://10.0.0.9")
    with pytest.raises(DocumentError, match="is no radio; write silvus:"):
        team.with_robots({"io": {"radio": "silvus://10.0.0.9:99999"}})


def test_ours_are_registered_as_those_of_others_are():
    text = (ROOT / "packaging" / "mocha-link" / "pyproject.toml").read_text()
    assert tomllib.loads(text)["project"]["entry-points"][RADIO_GROUP] == OURS
    for scheme, value in OURS.items():
        assert callable(metadata.EntryPoint(scheme, value, RADIO_GROUP).load())
