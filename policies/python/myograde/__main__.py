"""python -m myograde: what participants do on their own machine. See `--help`."""

from __future__ import annotations

import argparse
import json
import sys

from . import __version__, bundle, models
from .errors import MyogradeError, WrongUse

DONE, WRONG_USE, TROUBLE = 0, 2, 4  # as of the program myograde


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m myograde", description="Prepares submissions and models on this machine.")
    parser.add_argument("--version", action="version", version=__version__)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    bundling = verbs.add_parser(
        "bundle", help="put the kit into a submission's folder",
        description="Puts the kit and the message types into a submission's folder, as the folder "
        "myograde, in place of an older kit there. A grader has no other copy, so that a result "
        "depends on nothing but the submission.",
        epilog="example: python -m myograde bundle still")
    bundling.add_argument("folder", metavar="FOLDER", help="the submission's folder")
    getting = verbs.add_parser(
        "get-models", help="get MuJoCo 2.2.2 and the challenge's models",
        description="Gets MuJoCo 2.2.2 and the challenge's models by pip (90 MB), checks their "
        "SHA-256 and unpacks them into the cache. What is there already is left as it is.",
        epilog="example: python -m myograde get-models --cache ~/models")
    getting.add_argument("--cache", metavar="DIR", help="folder for them (default: MYOGRADE_CACHE, "
                         "else /var/cache/myograde for root and ~/.cache/myograde for others)")
    for verb in (bundling, getting):
        verb.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _bundle(options: argparse.Namespace) -> None:
    made = bundle.bundle(options.folder)
    if options.json:
        print(json.dumps({"folder": str(made.folder), "files": made.files,
                          "replaced": made.replaced}))
        return
    print(f"{made.folder} {'is replaced by' if made.replaced else 'holds'} the kit "
          f"({made.files} files).")
    if not made.has_manifest:
        print('The folder has no policy.json yet, such as {"name": "my-policy", "command": '
              '["python3", "policy.py"], "runtimes": ["python"]}.')


def _get_models(options: argparse.Namespace) -> None:
    def tell(sentence: str) -> None:
        print(sentence, file=sys.stderr if options.json else sys.stdout, flush=True)

    got = models.get_models(options.cache, tell)
    if options.json:
        print(json.dumps({"cache": str(got.cache), "fetched": got.fetched,
                          "folders": [str(folder) for folder in got.folders]}))
    elif not got.fetched:
        print(f"Everything is there already: {', '.join(str(folder) for folder in got.folders)}")


def main() -> int:
    options = _parser().parse_args()
    try:
        {"bundle": _bundle, "get-models": _get_models}[options.verb](options)
    except WrongUse as error:
        print(f"myograde: error: {error}", file=sys.stderr)
        return WRONG_USE
    except MyogradeError as error:
        print(f"myograde: error: {error}", file=sys.stderr)
        return TROUBLE
    return DONE


if __name__ == "__main__":
    sys.exit(main())
