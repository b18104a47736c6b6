"""The programs of docs/embedding.md pass ``mypy --strict``: so does a planner that begins as one.

A minute on a busy machine: `make docs-test`.
"""

import mypy.api

from tests.docs.blocks import blocks


def test_the_programs_are_typed(tmp_path):
    programs = [b for b in blocks() if b.page.name == "embedding.md" and b.language == "python"]
    assert len(programs) == 3
    for number, program in enumerate(programs):
        (tmp_path / f"program_{number}.py").write_text(program.text)
    found, errors, _ = mypy.api.run(["--strict", "--config-file=", str(tmp_path)])
    assert found.startswith("Success"), found + errors
