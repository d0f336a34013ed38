"""The command line as `python -m piezoharvest`."""

import sys

from piezoharvest.cli import main

sys.exit(main())
