"""python -m myograde: what participants do on their own machine. See `--help`."""

from __future__ import annotations

import argparse
import json
import sys

from . import __version__, bundle, models
from .errors import MyogradeError, WrongUse

DONE, DIFFERENT, WRONG_USE, TROUBLE = 0, 1, 2, 4  # as of the program myograde


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m myograde", description="Prepares submissions and models on this machine.")
    parser.add_argument("--version", action="version", version=__version__)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    bundling = verbs.add_parser(
        "bundle", help="copy the kit into a submission's folder",
        description="Copies the kit and the message types into a submission's folder, as the folder myograde, "
        "replacing an older kit there. A grader has no other copy, so a result depends on nothing but the "
        "submission.",
        epilog="example: python -m myograde bundle still")
    bundling.add_argument("folder", metavar="FOLDER", help="the submission's folder")
    getting = verbs.add_parser(
        "get-models", help="download MuJoCo 2.2.2 and the challenge's models",
        description="Downloads MuJoCo 2.2.2 and the challenge's models with pip (90 MB), checks their SHA-256 and "
        "unpacks them into the cache. What is already there is left unchanged.",
        epilog="example: python -m myograde get-models --cache ~/models")
    getting.add_argument("--cache", metavar="DIR", help="folder for them (default: MYOGRADE_CACHE, "
                         "else ~/.cache/myograde if it has the models, else /var/cache/myograde if that does)")
    running = verbs.add_parser(
        "run", help="run a script whose environments compute the same as a grader, to the bit",
        description="Runs a Python script with the C library's maths functions that every grader uses, whatever the "
        "processor, so that myograde.envs.exact() is true in it.",
        epilog="example: python -m myograde run train.py --steps 100000")
    running.add_argument("words", metavar="SCRIPT ...", nargs=argparse.REMAINDER,
                         help="the script (or -m MODULE) and its arguments")
    checking = verbs.add_parser(
        "check", help="check whether this machine reproduces a server's digests",
        description="Plays the episodes shipped with the package as a grader would, and compares each observation and "
        "state with the grader's, to the bit. Exit status 1 if they differ.",
        epilog="example: python -m myograde check")
    checking.add_argument("--cache", metavar="DIR", help="folder of the models (default: as for get-models)")
    for verb in (bundling, getting, checking):
        verb.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _bundle(options: argparse.Namespace) -> None:
    made = bundle.bundle(options.folder)
    if options.json:
        print(json.dumps({"folder": str(made.folder), "files": made.files,
                          "replaced": made.replaced}))
        return
    print(f"{made.folder} {'was replaced with' if made.replaced else 'has'} the kit "
          f"({made.files} files).")
    if not made.has_manifest:
        print('The folder has no policy.json yet; add one such as {"name": "my-policy", "command": '
              '["python3", "policy.py"], "runtimes": ["python"]}.')


def _get_models(options: argparse.Namespace) -> None:
    def tell(sentence: str) -> None:
        print(sentence, file=sys.stderr if options.json else sys.stdout, flush=True)

    got = models.get_models(options.cache, tell)
    if options.json:
        print(json.dumps({"cache": str(got.cache), "fetched": got.fetched,
                          "folders": [str(folder) for folder in got.folders]}))
    elif not got.fetched:
        print(f"Everything is already there: {', '.join(str(folder) for folder in got.folders)}")


def _run(options: argparse.Namespace) -> None:
    from .envs import check
    words = options.words[1:] if options.words[:1] == ["--"] else options.words
    if not words:
        raise WrongUse("run needs a script, such as: python -m myograde run train.py")
    check.become_pinned(words)


def _check(options: argparse.Namespace) -> int:
    from .envs import check, exact
    if not check.is_pinned_as_far_as_possible():
        check.become_pinned(["-m", "myograde", *sys.argv[1:]])
    played = check.check(options.cache)
    equal = exact() and all(episode.equal for episode in played)
    if options.json:
        print(json.dumps({"equal": equal, "tracks": {
            episode.track: {"equal": episode.equal, "steps": episode.steps,
                            "detail": episode.detail} for episode in played}}))
    else:
        for episode in played:
            print(f"{episode.track}: " + (f"{episode.steps} steps, equal to the bit"
                                          if episode.equal else episode.detail))
        print("Digests computed here equal a server's." if equal else
              "Digests computed here may differ from a server's, which does not matter for training.")
    return DONE if equal else DIFFERENT


def main() -> int:
    options = _parser().parse_args()
    verbs = {"bundle": _bundle, "get-models": _get_models, "run": _run, "check": _check}
    try:
        return verbs[options.verb](options) or DONE
    except WrongUse as error:
        print(f"myograde: error: {error}", file=sys.stderr)
        return WRONG_USE
    except MyogradeError as error:
        print(f"myograde: error: {error}", file=sys.stderr)
        return TROUBLE


if __name__ == "__main__":
    sys.exit(main())
