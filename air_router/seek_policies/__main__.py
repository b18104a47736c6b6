"""Prints a seek policy to begin with: `python -m air_router.seek_policies > my_policy.py`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.stdout.write(Path(__file__).with_name("template.py").read_text(encoding="utf-8"))
