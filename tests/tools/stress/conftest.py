"""The areas of the stress test are imported as ``tools/stress.py`` imports them."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[3] / "tools"))
