"""The documentation names every key, and its examples are teams."""

import re
from pathlib import Path

import pytest

from mocha_link.team.team import Team
from mocha_link.team.team_file import RobotModel, TopicModel, Trigger
from tests.mocha_link.conftest import team_of

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("model", [RobotModel, TopicModel, Trigger])
def test_every_key_is_documented_with_its_default(model):
    text = (DOCS / "team-file.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+?) \|", text, re.MULTILINE))
    for name, field in model.model_fields.items():
        if field.is_required():
            assert rows[name] == "required"
        elif field.default is None:
            assert rows[name] == "none"
        else:
            shown = rows[name].strip('`"')
            default = getattr(field.default, "name", field.default)  # of a word
            assert shown == str(default).lower() or float(shown) == default


def test_the_examples_are_teams():
    text = (DOCS / "team-file.md").read_text()
    team, two_nodes = (
        team_of(example) for example in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    )
    assert team.robot("titan").port_for("io") == 24400
    assert two_nodes.robot("a").peers == ("b",)
    assert two_nodes.dump() == Team.load(DOCS.parent / "missions" / "two" / "team.yaml").dump()
