"""Arguments of `ohmward demo`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.parser import count


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward demo`.

    ohmward demo
    ohmward demo --out my-demo --seed 7
    """
    parser.add_argument("--out", default="ohmward-demo", metavar="FOLDER", help="default: %(default)s")
    parser.add_argument("--seed", type=count, default=1, metavar="N", help="another seed, another day (default 1)")
