"""A tag is released only if version and changelog agree with it, and the demo needs no checkout."""

import runpy
from pathlib import Path

import pytest

import mocha_link
from air_router.mission import load_mission
from air_router.sim.demo import demo_or
from tests.distributions import ROOT

RELEASE = runpy.run_path(str(ROOT / "packaging" / "release.py"))
CHANGELOG = """# Changelog

## [Unreleased]

## [1.2.3] - 2026-11-29

### Added

- A thing.

## [1.2.2] - 2026-11-01

- Another.
"""


def source(version):
    return f'"""Doc."""\n__version__ = "{version}"\n'


def test_the_notes_of_a_tag_are_its_section_of_the_changelog():
    text = RELEASE["release"]("v1.2.3", source("1.2.3"), CHANGELOG)
    assert text == "### Added\n\n- A thing.\n"
    assert RELEASE["release"]("v1.2.2", source("1.2.2"), CHANGELOG) == "- Another.\n"


@pytest.mark.parametrize(
    ("tag", "version", "changelog", "why"),
    [
        ("v1.2.4", "1.2.3", CHANGELOG, "the tag is v1.2.4, but the sources are version 1.2.3"),
        ("1.2.3", "1.2.3", CHANGELOG, "the tag is 1.2.3"),
        ("v1.2.4", "1.2.4", CHANGELOG, "no section '## [1.2.4] - DATE'"),
        ("v1.2.3", "1.2.3", CHANGELOG.replace("2026-11-29", "unreleased"), "has no date"),
    ],
)
def test_a_tag_that_does_not_fit_is_refused(tag, version, changelog, why):
    with pytest.raises(RELEASE["NotReleasableError"]) as refused:
        RELEASE["release"](tag, source(version), changelog)
    assert why in str(refused.value)


def test_the_version_of_the_sources_is_in_the_changelog():
    sources = (ROOT / "mocha_link" / "__init__.py").read_text(encoding="utf-8")
    assert RELEASE["version_of"](sources) == mocha_link.__version__
    base = mocha_link.__version__.split(".dev")[0]
    assert f"## [{base}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_demo_names_the_packaged_mission_unless_a_file_has_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mission = load_mission(demo_or(Path("demo")))
    assert mission.uav == load_mission(ROOT / "missions" / "pennovation" / "mission.yaml").uav
    Path("demo").touch()
    assert demo_or(Path("demo")) == Path("demo")
    assert demo_or(Path("mine.yaml")) == Path("mine.yaml")
