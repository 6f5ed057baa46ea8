"""`python -m focusjax` is the `focusjax` command."""

import sys

from focusjax.cli import main

sys.exit(main())
