"""Requirements files: what is accepted, how pins are made, and how pip installs them."""

from __future__ import annotations

import json
import pathlib
import re
import shutil
import urllib.parse
import urllib.request

import tree
from failure import Trouble, WrongUse
from worker import Worker

# A requirement as pip has it, pinned: name, extras, version, marker, hashes.
_PINNED = re.compile(r"[A-Za-z0-9._-]+(\[[A-Za-z0-9._, -]+\])?\s*==\s*[^\s;*]+(\s*;[^#]*?)?"
                     r"(\s+--hash=sha256:[0-9a-f]{64})+")
_PIP = ("--disable-pip-version-check", "--no-input", "--only-binary", ":all:")


def lines_of(path: pathlib.Path) -> list[str]:
    """The requirements, without comments and with continued lines joined."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise WrongUse(f"{path}: can't be read: {error}") from error
    joined = text.replace("\\\n", " ")
    lines = [re.sub(r"(^|\s)#.*$", "", line).strip() for line in joined.splitlines()]
    return [line for line in lines if line]


def check(path: pathlib.Path) -> None:
    """WrongUse unless each requirement is one version with its SHA-256."""
    for line in lines_of(path):
        if line.startswith("-"):
            raise WrongUse(f'{path}: "{line}" is an option of pip; a runtime takes requirements only, '
                           "and options from the environment (PIP_INDEX_URL)")
        if not _PINNED.fullmatch(line):
            raise WrongUse(f'{path}: "{line}" is not pinned as NAME==VERSION --hash=sha256:...; '
                           "--lock finds the versions and writes such a file beside this one")


def lock(python: str, path: pathlib.Path, wheels: list[str], provided: list[str],
         worker: Worker) -> pathlib.Path:
    """Resolves the requirements, with all that they need, and writes the pins to NAME.lock.txt
    beside them; that file. What Debian's packages in `provided` hold is left out, unless the
    requirements name it themselves, and so is what nothing else needs: python3-torch in place of torch
    leaves out CUDA."""
    for line in lines_of(path):
        if line.startswith("-"):
            raise WrongUse(f'{path}: "{line}" is an option of pip; a runtime takes requirements only')
    given = _give(path, worker)
    worker.run([python, "-m", "pip", "install", *_PIP, *wheels, "--dry-run", "--ignore-installed",
                "--quiet", "--report", "report.json", "--target", "none", "-r", given],
               "finding versions")
    report = worker.folder / "report.json"
    pins = sorted(f"{item['metadata']['name'].lower()}=={item['metadata']['version']} --hash=sha256:"
                  f"{_sha256_of(item)}\n"
                  for item in _needed(json.loads(report.read_text(encoding="utf-8"))["install"],
                                      {_plain(name.removeprefix("python3-")) for name in provided}))
    report.unlink()
    locked = path.with_name(path.stem + ".lock.txt")
    try:
        locked.write_text(f"# Found for {path.name}.\n" + "".join(pins), encoding="utf-8")
    except OSError as error:
        raise WrongUse(f"{locked}: can't be written: {error.strerror}") from error
    return locked


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _needed(items: list[dict], provided: set[str]) -> list[dict]:
    """Those entries of a report that are needed where `provided` is there already."""
    by_name = {_plain(item["metadata"]["name"]): item for item in items}
    waiting = [name for name, item in by_name.items() if item.get("requested")]
    kept: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name in kept or name not in by_name:
            continue
        kept.add(name)
        for needs in by_name[name]["metadata"].get("requires_dist") or ():
            further = _plain(re.match(r"[A-Za-z0-9._-]+", needs).group())
            if further not in provided:
                waiting.append(further)
    return [by_name[name] for name in sorted(kept)]


def install(python: str, path: pathlib.Path, wheels: list[str], worker: Worker
            ) -> tuple[pathlib.Path, list[dict]]:
    """Installs pinned requirements into a folder of the worker; it and its packages."""
    target = worker.folder / "pip"
    if not lines_of(path):
        target.mkdir()
        return target, []
    worker.run([python, "-m", "pip", "install", *_PIP, *wheels, "--no-deps", "--require-hashes",
                "--no-compile", "--no-cache-dir", "--quiet", "--ignore-installed", "--report",
                "report.json", "--target", "pip", "-r", _give(path, worker)], "installing packages")
    report = json.loads((worker.folder / "report.json").read_text(encoding="utf-8"))
    if not target.is_dir():
        raise Trouble("pip installed nothing, and gave no reason")
    packages = [{"name": item["metadata"]["name"], "version": item["metadata"]["version"],
                 "source": "pypi",
                 "sha256": _sha256_of(item)}
                for item in report["install"]]
    return target, packages


def _sha256_of(item: dict) -> str:
    """The SHA-256 of what pip chose, an entry of its report; for files of a folder it gives none."""
    info = item["download_info"]
    known = info.get("archive_info", {}).get("hashes", {}).get("sha256")
    if known is None:
        known = tree.sha256(pathlib.Path(urllib.request.url2pathname(
            urllib.parse.urlsplit(info["url"]).path)))
    return known


def wheels_of(folder: str, worker: Worker) -> list[str]:
    """The options of pip that take wheels from a folder instead of the network."""
    if not folder:
        return []
    target = worker.folder / "wheels"
    target.mkdir()
    found = sorted(pathlib.Path(folder).glob("*.whl"))
    if not found:
        raise WrongUse(f"--wheels: {folder} holds no wheel (*.whl)")
    for wheel in found:
        shutil.copyfile(wheel, target / wheel.name)
        (target / wheel.name).chmod(0o644)
    return ["--no-index", "--find-links", "wheels"]


def compile_modules(python: str, tree_name: str, worker: Worker) -> None:
    """Compiles all modules, as policies can't keep what Python compiles. The results hold no time
    and no path. Modules that don't compile (for other versions of Python) stay as they are."""
    worker.run(["/bin/sh", "-c", '"$0" -m compileall -q -j 1 --invalidation-mode unchecked-hash '
                '-s "$1" "$1" || test $? = 1', python, tree_name], "compiling modules",
               PYTHONHASHSEED="0")


def _give(path: pathlib.Path, worker: Worker) -> str:
    shutil.copyfile(path, worker.folder / "requirements.txt")
    (worker.folder / "requirements.txt").chmod(0o644)
    return "requirements.txt"
