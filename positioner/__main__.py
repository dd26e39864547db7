"""`python -m positioner`."""

import sys

from positioner.start import main

sys.exit(main())
