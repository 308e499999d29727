"""Measurements of the planner; see ``scripts/bench`` and ``scripts/reference``."""

import sys
from pathlib import Path

# Behind everything installed: the wheel is measured, and only the tests are taken from here.
sys.path.append(str(Path(__file__).resolve().parents[2]))
