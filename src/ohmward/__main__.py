"""The script `ohmward`, and `python -m ohmward` where that is not on the path: the command line."""

import sys


def run() -> int:
    """Run the command line of sys.argv; its exit status. Ctrl-C is answered without a traceback from here on."""
    try:
        from ohmward.cli.main import main

        return main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(run())
