"""Makes `studies`, which several folders share, importable from all of them.

It is no part of this file because "from conftest import" finds whichever conftest.py was read last.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "engine"))

from studies import *  # noqa: F403
