"""python -m myograde.connect: grades what is submitted to EvalAI or Codabench. See `--help`."""

from __future__ import annotations

import argparse
import pathlib
import signal
import sys

from ..errors import MyogradeError, WrongUse
from . import codabench, verdict
from .settings import Settings
from .worker import Worker

VERBS = {
    "evalai": (lambda settings: Worker(settings).run(), "take submissions from EvalAI's queue until SIGTERM"),
    "check": (verdict.check, "say where EvalAI's order would differ from the boards; exit status 1 if it does"),
    "score": (codabench.score, "be the scoring program of a Codabench bundle", "INPUT", "OUTPUT")}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m myograde.connect", description="Grades on a server of MyoGrade "
                                     "what is submitted to EvalAI or Codabench. configs/EVALAI.md explains FILE.")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb, (do, about, *folders) in VERBS.items():
        made = verbs.add_parser(verb, help=about, description=about)
        made.add_argument("FILE")
        for folder in folders:
            made.add_argument(folder, type=pathlib.Path)
        made.set_defaults(do=do, folders=folders)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        return options.do(Settings(options.FILE), *(getattr(options, folder) for folder in options.folders)) or 0
    except MyogradeError as error:
        print(f"myograde.connect: error: {error}", file=sys.stderr)
        return 2 if isinstance(error, WrongUse) else 4


if __name__ == "__main__":
    sys.exit(main())
