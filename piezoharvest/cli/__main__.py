"""`python -m piezoharvest.cli` is the same as `piezoharvest`."""

import sys

from piezoharvest.cli import main

sys.exit(main())
