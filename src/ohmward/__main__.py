"""`python -m ohmward`: the command line where the script `ohmward` is not on the path."""

import sys

from ohmward.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
