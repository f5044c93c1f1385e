"""python -m myograde.connect: grades what is submitted to EvalAI or Codabench. See `--help`."""

from __future__ import annotations

import argparse
import pathlib
import signal
import sys

from ..errors import MyogradeError, WrongUse
from . import check, codabench
from .settings import Settings
from .worker import Worker

VERBS = {"evalai": ("take submissions from EvalAI's queue until SIGTERM", ()),
         "check": ("say where EvalAI's order would differ from the boards; exit status 1 if it does", ()),
         "score": ("be the scoring program of a Codabench bundle", ("INPUT", "OUTPUT"))}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m myograde.connect", description="Grades on a server of MyoGrade "
                                     "what is submitted to EvalAI or Codabench. configs/EVALAI.md explains FILE.")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb, (about, words) in VERBS.items():
        made = verbs.add_parser(verb, help=about, description=about)
        for word in ("FILE", *words):
            made.add_argument(word)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        settings = Settings(options.FILE)
        if options.verb == "check":
            return check.check(settings)
        if options.verb == "score":
            return codabench.score(settings, pathlib.Path(options.INPUT), pathlib.Path(options.OUTPUT))
        Worker(settings).run()
    except MyogradeError as error:
        print(f"myograde.connect: error: {error}", file=sys.stderr)
        return 2 if isinstance(error, WrongUse) else 4
    return 0


if __name__ == "__main__":
    sys.exit(main())
