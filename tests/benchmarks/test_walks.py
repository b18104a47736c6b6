"""The walks of a decision through the house are counted and printed."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_walk_is_walked_and_printed():
    """In a process of its own: what was asked before is remembered here and there."""
    command = [sys.executable, "-m", "benchmarks.walks"]
    walks = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert walks.returncode in {0, 1}, walks.stderr  # 1: over the budget beside it
    assert walks.stdout.count(" / ") >= 2 * 8, walks.stdout
