"""`python -m ohmward.cli`: the command line without its script on the path."""

import sys

from ohmward.cli.main import main

sys.exit(main())
