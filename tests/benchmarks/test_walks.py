"""The walks of a decision through the house stay within their budget."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_no_walk_is_over_its_budget():
    """In a process of its own: what was asked before is remembered here and there."""
    command = [sys.executable, "-m", "benchmarks.walks"]
    walks = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert walks.returncode == 0, walks.stdout + walks.stderr
