"""What `mocha-link check OLD NEW` reports of a roll-out."""

import json

import pytest

from mocha_link.cli.cli import main

TEAM = """\
robots:
  a: {kind: rover, address: 10.0.0.1, base_port: 10, clients: [b, c]}
  b: {kind: rover, address: 10.0.0.2, base_port: 10, clients: [a]}
  c: {kind: rover, address: 10.0.0.3, base_port: 10, clients: [a], original: true}
kinds:
  rover:
    topics:
      - {name: /pose, type: json/P, priority: high}
      - {name: /map, type: json/M, priority: low}
trust: relays
"""
KEYS = ("g0mq$FB$^@3*OV!T<zQB<0KG6Ckh1Z?hG1y#WY0T", "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7")


@pytest.fixture
def compared(tmp_path, capsys):
    """Compares two teams: the exit code, the changes that cut, and those that do not."""

    def compare(*changes, before=TEAM):
        after = before
        for old, new in changes:
            assert old in after
            after = after.replace(old, new)
        files = tmp_path / "old.yaml", tmp_path / "new.yaml"
        for path, text in zip(files, (before, after), strict=True):
            path.write_text(text)
        code = main(["check", "--json", *map(str, files)])
        found = json.loads(capsys.readouterr().out)
        assert code == found["cuts"] == any(change["cuts"] for change in found["changes"])
        assert main(["check", *map(str, files)]) == code
        text = capsys.readouterr().out
        for change in found["changes"]:
            assert change["effect"] in text
        name = "{subject} {key}".format
        return [
            {
                name(**change).strip(): change
                for change in found["changes"]
                if change["cuts"] == cuts
            }
            for cuts in (True, False)
        ]

    return compare


def test_the_same_team_in_another_notation(compared):
    assert compared(("base_port: 10, ", "base_port:   10, ")) == [{}, {}]


def test_what_is_a_matter_of_each_node(compared):
    cuts, others = compared(
        ("priority: low", "priority: medium, min_interval_s: 2"),
        ("clients: [a]}", "clients: [a], listen: 10.0.0.2}"),
        ("trust: relays", "trigger: {interval_s: 5}"),
    )
    assert cuts == {}
    assert others.keys() == {
        *("topic rover /map priority", "topic rover /map min_interval_s"),
        *("robot b listen", "trigger interval_s"),
    }
    assert others["trigger interval_s"]["old"] == "2.0"


def test_topics(compared):
    cuts, others = compared(
        ("type: json/P", "type: json/Pose"),
        (
            "type: json/M, priority: low}",
            "type: json/M, priority: low}\n      - {name: /x, type: a/A}",
        ),
    )
    assert others == {}
    assert cuts["topic rover /pose type"]["new"] == "json/Pose"
    assert cuts["topic rover /x"]["new"] == "added"
    assert cuts["topic rover /map type id"]["old"] == "0"  # A sorts before all others


def test_a_robot_between_the_others_shifts_their_ids(compared):
    new = "  aa: {kind: rover, address: 10.0.0.9, base_port: 10, clients: []}\n  b:"
    cuts, others = compared(("  b:", new))
    assert others == {}
    assert cuts.keys() == {"robot aa", "robot b id", "robot c id"}
    assert "robot a id" not in cuts


def test_links_that_come_and_go(compared):
    cuts, _ = compared(
        ("clients: [b, c]", "clients: [null, c]"),
        ("base_port: 10, clients: [a]}", "base_port: 10, clients: []}"),
    )
    assert "link a - b" in cuts
    fewer = TEAM.replace("clients: [b, c]", "clients: [null, c]").replace(
        "clients: [a]}", "clients: []}"
    )
    cuts, others = compared(
        ("[null, c]", "[b, c]"), ("clients: []}", "clients: [a]}"), before=fewer
    )
    assert cuts == {}
    assert others["link a - b"]["new"] == "added"


def test_addresses_and_ports(compared):
    one = ("10.0.0.2, base_port: 10", "10.0.0.2, base_port: 20")
    other = ("10.0.0.1, base", "b.local, base")
    cuts, others = compared(one)
    assert cuts == {}
    (change,) = others.values()
    assert "only b finds a" in change["effect"]
    assert (change["old"], change["new"]) == ("10.0.0.2, port 10", "10.0.0.2, port 20")
    cuts, _ = compared(one, other)
    assert {"link a - b where a is dialed", "link a - b where b is dialed"} <= cuts.keys()
    cuts, _ = compared(("10.0.0.3", "10.0.0.4"))
    assert (
        "the original node of c needs both ways" in cuts["link a - c where c is dialed"]["effect"]
    )


def test_keys_and_trust(compared):
    keyed = [
        (f"{name}: {{", f'{name}: {{key: "{key}", ') for name, key in zip("ab", KEYS, strict=True)
    ]
    cuts, others = compared(keyed[0])
    assert (cuts, others) == ({}, {})  # b has none
    cuts, _ = compared(*keyed)
    assert cuts.keys() == {"link a - b keys"}
    both = TEAM
    for old, new in keyed:
        both = both.replace(old, new)
    cuts, _ = compared((KEYS[1], KEYS[1][::-1]), before=both)
    assert cuts.keys() == {"link a - b keys"}
    cuts, _ = compared(("trust: relays", "trust: signed"), before=both)
    assert "those of c from relays" in cuts["team trust"]["effect"]
    signed = both.replace("trust: relays", "trust: signed")
    cuts, others = compared(("trust: signed", "trust: relays"), before=signed)
    assert cuts == {}
    assert others.keys() == {"team trust"}


def test_an_invalid_file_is_3(tmp_path, capsys):
    (tmp_path / "old.yaml").write_text(TEAM)
    (tmp_path / "new.yaml").write_text(TEAM.replace("kind: rover", "kind: boat"))
    assert main(["check", "--json", str(tmp_path / "old.yaml"), str(tmp_path / "new.yaml")]) == 3
    out, err = capsys.readouterr()
    assert json.loads(out)["problems"][0]["path"].endswith("new.yaml")
    assert "new.yaml:2:" in err
