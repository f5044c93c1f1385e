"""Makes and removes runtimes: `myograde runtime add` and `remove` become this program, and the set-up
makes the runtime `python` by it. ../README.md describes what it makes. Use: make_runtime.py --help"""

from __future__ import annotations

import argparse
import datetime
import fcntl
import hashlib
import json
import os
import pathlib
import re
import signal
import stat
import sys
import tempfile
import time
from typing import NoReturn

import debian
import requirements
import tree
from failure import Trouble, WrongUse, sanitized
from worker import NOBODY, Worker

NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")
# Seconds in which a lease that was given a runtime's folder has mounted it, with a lot to spare.
SETTLED = 10


class Place:
    """The runtimes' folder, locked: one program at a time changes it."""

    def __init__(self, folder: str) -> None:
        self.folder = pathlib.Path(os.path.abspath(folder))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = open(self.folder / ".lock", "wb")  # pylint: disable=consider-using-with
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise Trouble(f"{self.folder}: another myograde runtime works there; wait until it is "
                          "done") from error
        except OSError as error:
            raise WrongUse(f"{self.folder}: can't be written to ({error.strerror}); runtimes are "
                           "made by the user that owns this folder") from error
        for left in self.folder.glob(tree.PART + "*"):  # of one that was killed
            tree.remove(left)

    def of(self, name: str) -> pathlib.Path:
        if not NAME.fullmatch(name):
            raise WrongUse(f'"{name}" can\'t be the name of a runtime: 1 to 64 of a-z, 0-9, ".", "_" '
                           'and "-", the first a letter or digit')
        return self.folder / name

    def part(self) -> pathlib.Path:
        return pathlib.Path(tempfile.mkdtemp(prefix=tree.PART, dir=self.folder))

    def version(self, name: str, digest: str) -> pathlib.Path:
        """Where a runtime of that content lies as long as it exists: a lease may be about to mount
        it, so a folder never gets another content."""
        return self.folder / f"{name}@{digest[:16]}"

    def present(self, name: str) -> pathlib.Path:
        """The folder that the name stands for."""
        link = self.of(name)
        return self.folder / os.readlink(link) if link.is_symlink() else link

    def former(self, name: str) -> list[pathlib.Path]:
        """The versions that the name stood for, those that earlier releases put aside as well."""
        versions = set(self.folder.glob(f"{name}@*")) - {self.present(name)}
        return sorted(versions) + sorted((self.folder / tree.FORMER).glob(f"{name}@*"))

    def give_version(self, name: str) -> bool:
        """Earlier releases kept a runtime in the folder NAME itself. It moves to its version's
        folder, and NAME becomes a link to it; whether that was to be done."""
        old = self.of(name)
        digest = description_of(old).get("digest")
        if old.is_symlink() or not digest:
            return False
        version = self.version(name, digest)
        if os.path.lexists(version):  # of one that was killed
            self.drop(version)
        os.symlink(version.name, version)
        if not tree.exchange(old, version):
            version.unlink()
            os.rename(old, version)
            tree.point(old, version)
        return True

    def drop(self, path: pathlib.Path) -> None:
        """Removes a runtime; it disappears as a whole."""
        if path.is_symlink():
            path.unlink()
            return
        part = self.part()
        tree.move(path, part / "gone")
        tree.remove(part)


def description_of(folder: pathlib.Path) -> dict:
    try:
        return json.loads((folder / tree.DESCRIPTION).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def recipe_digest(args: argparse.Namespace, path: pathlib.Path) -> str:
    recipe = [path.read_text(encoding="utf-8"), sorted(args.debian), args.python]
    return hashlib.sha256(json.dumps(recipe).encode()).hexdigest()


def check_python(python: str) -> str:
    """The version of the interpreter, "3.11". Policies see nothing of the host but /usr."""
    real = os.path.realpath(python)
    if not os.path.isabs(python) or not real.startswith("/usr/") or not os.access(real, os.X_OK):
        raise WrongUse(f"--python: {python} is not a program below /usr, and nothing else of this host is "
                       "shown to policies; for another Python, submit an image that holds it")
    probe = Worker(pathlib.Path(tempfile.mkdtemp()) / "probe", 60, 1 << 30)
    try:
        os.chmod(probe.folder.parent, 0o711)
        return probe.run([python, "-c", "import pip, sys; print('%d.%d' % sys.version_info[:2])"],
                         "asking Python for its version").split()[-1]
    except Trouble as error:
        raise WrongUse(f"--python: {python} can't be used: {error}") from error
    finally:
        tree.remove(probe.folder.parent)


def workshop(part: pathlib.Path) -> pathlib.Path:
    """Where packages are got and unpacked: in the part, or in TMPDIR if the user nobody, as whom
    root has it done, can't come to the part."""
    part.chmod(0o711)
    reachable = all(parent.stat().st_mode & stat.S_IXOTH for parent in part.parents)
    if os.geteuid() != 0 or reachable:
        return part
    other = pathlib.Path(tempfile.mkdtemp(prefix="myograde-runtime."))
    other.chmod(0o711)
    return other


def add(args: argparse.Namespace) -> None:
    place = Place(args.dir)
    target = place.of(args.name)
    path = pathlib.Path(args.requirements)
    if path.is_dir():
        args.debian = args.debian + debian.names_in(path / "debian.txt")
        path = path / "requirements.txt"
    made_from = "" if args.lock else (requirements.check(path) or recipe_digest(args, path))
    if args.if_changed and description_of(target).get("made_from") == made_from:
        return
    if os.path.lexists(target) and not (args.replace or args.if_changed):
        raise WrongUse(f"there is a runtime \"{args.name}\" already; --replace makes it anew, and keeps "
                       "the present one for evaluations that began with it")
    python = check_python(args.python)
    moved = time.monotonic() if place.give_version(args.name) else 0
    part = place.part()
    shop = workshop(part)
    try:
        worker = Worker(shop / "work", args.timeout, args.most_bytes)
        new = build(args, path, python, worker, part / "new")
        if moved:
            time.sleep(max(0, SETTLED - (time.monotonic() - moved)))
        finish(args, place, new)
    finally:
        for folder in {part, shop}:
            tree.remove(folder)


def build(args: argparse.Namespace, path: pathlib.Path, python: str, worker: Worker,
          new: pathlib.Path) -> pathlib.Path:
    """Makes the runtime's whole folder at `new`."""
    wheels = requirements.wheels_of(args.wheels, worker)
    if args.lock:
        path = requirements.lock(args.python, path, wheels, args.debian, worker)
    requirements.check(path)
    raw, packages = requirements.install(args.python, path, wheels, worker)
    if args.debian:
        packages += debian.install(args.debian, raw, worker)
    for folder, _, files in os.walk(raw):
        worker.give(pathlib.Path(folder))
        for name in files:
            worker.give(pathlib.Path(folder) / name)
    requirements.compile_modules(args.python, raw.name, worker)
    if not packages:
        raise WrongUse(f"{path}: names no package, and --debian names none; a runtime of nothing is of "
                       "no use")
    tree.copy_tree(raw, new)
    (new / "requirements.txt").write_bytes(path.read_bytes())
    digest, size, count = tree.listing(new)
    if size > args.most_bytes:
        raise WrongUse(f"the runtime has {size} bytes, and at most {args.most_bytes} are allowed; name "
                       "fewer packages, or raise --most-bytes")
    now = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    described = {"format": 1, "runtime": args.name, "digest": digest, "python": python,
                 "made_at": now, "made_from": recipe_digest(args, path), "bytes": size,
                 "files": count, "packages": sorted(packages, key=lambda entry: entry["name"])}
    (new / tree.DESCRIPTION).write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return new


def finish(args: argparse.Namespace, place: Place, new: pathlib.Path) -> None:
    """Puts a whole runtime in its place."""
    link = place.of(args.name)
    tree.close(new)
    tree.sync(new)
    described = description_of(new)
    version = place.version(args.name, described["digest"])
    if version.exists() and tree.listing(version)[0] != described["digest"]:  # it was damaged
        place.drop(version)
    if not version.exists():
        if version.is_symlink():  # of one that was killed
            version.unlink()
        tree.move(new, version)
    if link.is_dir() and not link.is_symlink():  # nobody described it
        place.drop(link)
    tree.point(link, version)
    if args.json:
        del described["format"], described["made_from"]
        for package in described["packages"]:
            del package["sha256"]
        print(json.dumps({**described, "folder": str(version)}, indent=2))
    else:
        count = len(described["packages"])
        print(f"The runtime {args.name} is made: {count} package{'s' if count != 1 else ''}, "
              f"{described['bytes'] / 1e6:.1f} MB, digest {described['digest'][:12]}, "
              f"in {sanitized(version)}")


def remove(args: argparse.Namespace) -> None:
    place = Place(args.dir)
    there = place.former(args.name)
    if not args.former:
        # One and the same for what earlier releases made.
        there = [*dict.fromkeys((place.of(args.name), place.present(args.name))), *there]
    there = [path for path in there if os.path.lexists(path)]
    if not there:
        raise WrongUse(f"{place.folder} holds no " + ("former version of the " if args.former else "")
                       + f'runtime "{args.name}"; myograde runtime list shows what there is')
    for path in there:
        place.drop(path)
    if args.json:
        print(json.dumps({"runtime": args.name, "removed": [str(path) for path in there]}, indent=2))
    else:
        print(f"Removed {', '.join(map(sanitized, there))}")


def options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make_runtime.py", description=__doc__)
    verbs = parser.add_subparsers(required=True)
    adds = verbs.add_parser("add")
    adds.add_argument("dir")
    adds.add_argument("name")
    adds.add_argument("requirements")
    adds.add_argument("--debian", action="append", default=[])
    adds.add_argument("--python", default="/usr/bin/python3")
    adds.add_argument("--wheels", default="")
    adds.add_argument("--lock", action="store_true")
    adds.add_argument("--replace", action="store_true")
    adds.add_argument("--if-changed", action="store_true")
    adds.add_argument("--timeout", type=float, default=3600)
    adds.add_argument("--most-bytes", type=int, default=8 << 30)
    adds.set_defaults(run=add)
    removes = verbs.add_parser("remove")
    removes.add_argument("dir")
    removes.add_argument("name")
    removes.add_argument("--former", action="store_true")
    removes.set_defaults(run=remove)
    for verb in (adds, removes):
        verb.add_argument("--json", action="store_true")
    return parser


def stopped(number: int, _frame: object) -> NoReturn:
    raise SystemExit(128 + number)


def main() -> int:
    os.umask(0o022)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, stopped)
    args = options().parse_args()
    try:
        args.run(args)
        return 0
    except WrongUse as error:
        print(f"myograde: error: {sanitized(error)}", file=sys.stderr)
        return 2
    except (Trouble, OSError) as error:
        print(f"myograde: error: {sanitized(error)}", file=sys.stderr)
        return 4


if __name__ == "__main__":
    sys.exit(main())
