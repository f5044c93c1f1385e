"""Python packages of Debian as part of a runtime: apt-get chooses and checks them (versions and
SHA-256 from its signed index), dpkg-deb unpacks them into the runtime, and nothing is installed."""

from __future__ import annotations

import os
import pathlib
import re
import shutil

import tree
from failure import Trouble, WrongUse
from worker import Worker

# What every host has that runs policies in Python; not part of a runtime.
BASE = ("python3", "libstdc++6")
# Folder of a runtime that is on LD_LIBRARY_PATH of policies (server/sandbox/policy_sandbox.cc).
LIBRARIES = "debian-lib"
_LOADER = "/lib64/ld-linux-x86-64.so.2"
_PACKAGES = "usr/lib/python3/dist-packages"
_LINE = re.compile(r"Inst (\S+) \((\S+) ")
_NEEDED = re.compile(r"\s*(\S+) => (not found|\S+)")


def names_in(path: pathlib.Path) -> list[str]:
    """The packages that the file of a recipe names, one a line; none if it is not there."""
    if not path.exists():
        return []
    lines = [line.partition("#")[0].strip() for line in path.read_text(encoding="utf-8").splitlines()]
    return [line for line in lines if line]


def install(names: list[str], target: pathlib.Path, worker: Worker) -> list[dict]:
    """Adds the Python packages `names` of Debian, with all that they need and the host's Python does
    not bring, to the tree `target`: modules at its top unless they are there already, shared
    libraries in debian-lib/. Returns the packages."""
    for name in names:
        if not re.fullmatch(r"[a-z0-9][a-z0-9+.-]+", name):
            raise WrongUse(f'--debian: "{name}" is not a name of a Debian package')
    # Asked for a host without any package, so that the answer does not depend on this one's.
    (worker.folder / "no-packages").touch(0o644)
    base = _closure(list(BASE), worker)
    wanted = {name: version for name, version in _closure(names, worker).items()
              if name not in base}
    packages = _unpack(wanted, worker)
    added = _add_modules(worker.folder / "debian", target)
    _add_libraries(worker.folder / "debian", target, added, worker)
    return packages


def _closure(names: list[str], worker: Worker) -> dict[str, str]:
    try:
        text = worker.run(["apt-get", "install", "--simulate", "--no-install-recommends", "-o",
                           "Debug::NoLocking=1", "-o", "Dir::State::status=no-packages", "-o",
                           f"Dir::State::status={worker.folder}/no-packages", *names],
                          "choosing Debian packages")
    except Trouble as error:
        raise Trouble(f"{error}; see whether the name is right, and whether apt-get update works "
                      "here") from error
    return dict(match.groups() for line in text.splitlines() if (match := _LINE.match(line)))


def _unpack(wanted: dict[str, str], worker: Worker) -> list[dict]:
    folder = worker.folder / "debs"
    folder.mkdir()
    worker.give(folder)
    versions = [f"{name}={version}" for name, version in sorted(wanted.items())]
    worker.run(["/bin/sh", "-c", 'cd debs && exec apt-get download -q "$@"', "sh",
                "-o", "Debug::NoLocking=1", "-o", "APT::Sandbox::User=", *versions],
               "getting Debian packages")
    found = {path.name.split("_")[0]: path for path in folder.glob("*.deb")}
    packages = []
    for name, version in sorted(wanted.items()):
        if name not in found:
            raise Trouble(f"apt-get did not bring the package {name}")
        worker.run(["dpkg-deb", "--extract", f"debs/{found[name].name}", "debian"],
                   "unpacking Debian packages")
        packages.append({"name": name, "version": version, "source": "debian",
                         "sha256": tree.sha256(found[name])})
        found[name].unlink()
    return packages


def _add_modules(root: pathlib.Path, target: pathlib.Path) -> list[pathlib.Path]:
    place = root / _PACKAGES
    if not place.is_dir():
        raise WrongUse("--debian: these packages hold no Python module")
    there = {path.name for path in target.iterdir()}
    added = [path for path in sorted(place.iterdir()) if path.name not in there]
    for path in added:
        _take(path, target / path.name, root)
    return [target / path.name for path in added]


def _take(source: pathlib.Path, target: pathlib.Path, root: pathlib.Path) -> None:
    """Copies a module. Links to libraries lead to debian-lib/, others become what they lead
    to, and those that lead out of the packages are left out."""
    if source.is_dir() and not source.is_symlink():
        target.mkdir()
        for path in sorted(source.iterdir()):
            _take(path, target / path.name, root)
        return
    end = _end_of(source, root)
    if end is None:
        return
    if source.is_symlink() and ".so" in end.name and end.is_file():
        depth = len(target.parent.relative_to(_top(target)).parts)
        os.symlink("../" * depth + f"{LIBRARIES}/{end.name}", target)
    elif end.is_dir():
        shutil.copytree(end, target, symlinks=False, ignore_dangling_symlinks=True)
    elif end.is_file():
        shutil.copyfile(end, target)
        target.chmod(end.stat().st_mode & 0o777)


def _top(path: pathlib.Path) -> pathlib.Path:
    """The tree that a path below worker.folder/pip lies in."""
    for parent in path.parents:
        if parent.name == "pip":
            return parent
    raise AssertionError(path)


def _end_of(path: pathlib.Path, root: pathlib.Path) -> pathlib.Path | None:
    """What a path leads to, with absolute links taken as if `root` were /; None: it is not there."""
    for _ in range(40):
        if not path.is_symlink():
            return path if path.exists() else None
        words = os.readlink(path)
        path = root / words.lstrip("/") if words.startswith("/") else path.parent / words
        path = pathlib.Path(os.path.normpath(path))
        if not path.is_relative_to(root):
            return None
    return None


def _add_libraries(root: pathlib.Path, target: pathlib.Path, added: list[pathlib.Path],
                   worker: Worker) -> None:
    """Puts each shared library that a module needs, or that such a library needs, into debian-lib/ under
    the name by which it is asked for. The loader says which, without running any of them."""
    linked = _linked(target, root)
    modules = [path for top in added for path in [top, *top.rglob("*.so*")]
               if path.is_file() and not path.is_symlink()] + linked
    folders = sorted({str(path.parent) for path in _libraries(root)},
                     key=lambda name: (name.count("/"), name))
    lib = target / LIBRARIES
    needed: dict[str, pathlib.Path] = {path.name: path for path in linked}
    for path in modules:
        if not _is_elf(path):
            continue
        text = worker.run([_LOADER, "--library-path", ":".join(folders), "--list", str(path)],
                          "finding libraries")
        for name, place in (match.groups() for match in map(_NEEDED.match, text.splitlines())
                            if match):
            if place == "not found":
                raise Trouble(f"{path.name} of the Debian packages needs the library {name}, which "
                              "neither they nor this host have")
            if place.startswith(str(root)):
                needed.setdefault(name, pathlib.Path(place))
    lib.mkdir(exist_ok=True)
    for name, place in sorted(needed.items()):
        if not (lib / name).exists():
            shutil.copyfile(place, lib / name)
            (lib / name).chmod(0o644)


def _linked(target: pathlib.Path, root: pathlib.Path) -> list[pathlib.Path]:
    """The libraries that links of modules lead to."""
    names = {os.path.basename(os.readlink(path)) for path in target.rglob("*.so*")
             if path.is_symlink()}
    return [path for path in _libraries(root)
            if path.name in names and path.is_file() and not path.is_symlink()]


def _libraries(root: pathlib.Path) -> list[pathlib.Path]:
    """Debian 12 has packages that still use /lib, which is a link to /usr/lib on every host."""
    found = [path for top in ("usr/lib", "lib") for path in (root / top).rglob("*.so*")]
    return sorted(path for path in found if _PACKAGES not in str(path))


def _is_elf(path: pathlib.Path) -> bool:
    with open(path, "rb") as file:
        return file.read(4) == b"\x7fELF"
