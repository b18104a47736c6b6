"""Prints a robot's policy to begin with: `python -m sitl.robot_policies > my_robots.py`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.stdout.write(Path(__file__).with_name("template.py").read_text(encoding="utf-8"))
