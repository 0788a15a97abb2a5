"""`python -m accelbench` is the command."""

import sys

from accelbench.start import main

sys.exit(main())
