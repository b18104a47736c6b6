"""`python -m benchmarks.countries FOLDER ...`; see `benchmarks.countries.compare`."""

import sys

from benchmarks.countries.compare import main

sys.exit(main())
