"""`python -m mjx_cutting` is `mjx-cutting`."""

import sys

from mjx_cutting.cli import main

sys.exit(main())
