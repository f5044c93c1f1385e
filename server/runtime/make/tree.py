"""The folder of a runtime: what may lie in it, its digest, and how it comes to its place."""

from __future__ import annotations

import ctypes
import errno
import hashlib
import json
import os
import pathlib
import shutil
import stat

from failure import WrongUse

DESCRIPTION = "runtime.json"
FORMER = ".former"
PART = ".part-"


def entries(root: pathlib.Path) -> list[pathlib.Path]:
    """Everything below `root`, relative to it, sorted by the bytes of its path; links are entries
    and not followed."""
    found: list[pathlib.Path] = []
    for folder, folders, files in os.walk(root):
        below = pathlib.Path(folder).relative_to(root)
        found += [below / name for name in folders + files]
    return sorted(found, key=lambda path: os.fsencode(path))


def listing(root: pathlib.Path) -> tuple[str, int, int]:
    """The digest of all below `root` but its description, its bytes and its number of entries, as
    server/runtime/runtimes.h has them."""
    digest = hashlib.sha256(b"myograde artefact 1\n")
    size = count = 0
    for path in entries(root):
        if str(path) == DESCRIPTION:
            continue
        line = _line(root / path, str(path))
        size += line.get("size", 0)
        count += 1
        text = json.dumps(line, sort_keys=True, separators=(",", ":"), ensure_ascii=False) + "\n"
        digest.update(text.encode())
    return digest.hexdigest(), size, count


def _line(path: pathlib.Path, name: str) -> dict:
    info = path.lstat()
    if stat.S_ISLNK(info.st_mode):
        return {"path": name, "type": "link", "target": os.readlink(path)}
    if stat.S_ISDIR(info.st_mode):
        return {"path": name, "type": "folder"}
    return {"path": name, "type": "file", "size": info.st_size, "sha256": sha256(path),
            "executable": bool(info.st_mode & stat.S_IXUSR)}


def sha256(path: pathlib.Path) -> str:
    with open(path, "rb") as file:
        digest = hashlib.sha256()
        while piece := file.read(1 << 20):
            digest.update(piece)
        return digest.hexdigest()


def bytes_below(root: pathlib.Path) -> int:
    total = 0
    for folder, _, files in os.walk(root):
        for name in files:
            try:
                total += os.lstat(os.path.join(folder, name)).st_size
            except FileNotFoundError:
                pass
    return total


def copy_tree(source: pathlib.Path, target: pathlib.Path) -> None:
    """Copies what packages put into `source`. Nothing of the copy belongs to who made `source`;
    links that lead out of it are left out, as they would lead elsewhere in a sandbox. WrongUse:
    something else than files, folders and links."""
    top = source.resolve()
    target.mkdir()
    for path in entries(source):
        name = str(path)
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise WrongUse(f"the packages hold a name that is not UTF-8: {name!r}") from error
        if name == DESCRIPTION:
            raise WrongUse(f"a package brings a file {DESCRIPTION}, which is the runtime's own")
        _copy(source / path, target / path, top)


def _copy(source: pathlib.Path, target: pathlib.Path, top: pathlib.Path) -> None:
    info = source.lstat()
    if stat.S_ISDIR(info.st_mode):
        target.mkdir()
    elif stat.S_ISLNK(info.st_mode):
        words = os.readlink(source)
        end = source.resolve()
        if not os.path.isabs(words) and end.is_relative_to(top) and end.exists():
            os.symlink(words, target)
    elif stat.S_ISREG(info.st_mode):
        shutil.copyfile(source, target)
        target.chmod(0o555 if info.st_mode & stat.S_IXUSR else 0o444)
    else:
        raise WrongUse(f"the packages hold {source.name}, which is not a file, folder or link")


def close(root: pathlib.Path) -> None:
    """Makes everything below `root` read-only, for all to read."""
    for folder, _, files in os.walk(root, topdown=False):
        for name in files:
            path = os.path.join(folder, name)
            if not os.path.islink(path):
                mode = os.lstat(path).st_mode
                os.chmod(path, 0o555 if mode & stat.S_IXUSR else 0o444)
        os.chmod(folder, 0o555)


def remove(root: pathlib.Path) -> None:
    """Removes a folder, read-only or not."""
    if root.is_symlink() or root.is_file():
        root.unlink()
        return
    for folder, _, _ in os.walk(root):
        os.chmod(folder, 0o700)
    shutil.rmtree(root)


def sync(path: pathlib.Path) -> None:
    """Waits until all of the file system that `path` is on is on the disk."""
    os.sync()


def exchange(one: pathlib.Path, other: pathlib.Path) -> bool:
    """Swaps two entries of a folder at once; False: this file system can't."""
    at_current_folder, exchanged = -100, 2  # AT_FDCWD, RENAME_EXCHANGE (renameat2(2))
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.renameat2(at_current_folder, os.fsencode(one), at_current_folder, os.fsencode(other),
                      exchanged) == 0:
        return True
    if ctypes.get_errno() in (errno.EINVAL, errno.ENOSYS):
        return False
    raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(one))


def point(link: pathlib.Path, target: pathlib.Path) -> None:
    """Makes `link` lead to `target`, which lies beside it, whatever it led to before."""
    draft = link.parent / f"{PART}{link.name}"
    draft.unlink(missing_ok=True)
    os.symlink(target.name, draft)
    os.rename(draft, link)


def move(source: pathlib.Path, target: pathlib.Path) -> None:
    """Renames a folder that may be read-only: its own entry `..` has to change."""
    mode = stat.S_IMODE(source.stat().st_mode)
    source.chmod(0o755)
    os.rename(source, target)
    target.chmod(mode)
