"""Packs a submission as a tar for the upload. The server checks every rule and names the entry that
breaks one; only mistakes that would make a wrong archive are found here."""

from __future__ import annotations

import errno
import io
import json
import os
import pathlib
import shutil
import stat
import tarfile
import tempfile
import zipfile
from typing import BinaryIO

from ..errors import MyogradeError, WrongUse

SENT_AS_THEY_ARE = (".tar", ".tar.gz", ".tgz", ".tar.zst", ".tzst", ".tar.xz", ".txz", ".tar.bz2",
                    ".tbz2", ".tbz")
COMPRESSED = (b"\x1f\x8b", b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd")
MAX_LINK_BYTES = 4096
MANIFESTS = ("policy.json", "./policy.json")
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


def pack(path: str | os.PathLike[str], target: BinaryIO, name: str | None = None, *,
         largest_bytes: int | None = None) -> None:
    """Writes to `target` a tar of the submission at `path`: a folder with a policy.json, one
    executable file, or an archive (.tar, .tar.gz, .tar.zst, .tar.xz, .tar.bz2, .zip) of such a folder or of a
    container image. `name` replaces the name in policy.json, or the name that an image was saved with.
    WrongUse names what can't be packed, such as a zip archive whose files have more than `largest_bytes` together;
    MyogradeError if this computer's disk is at fault."""
    source = pathlib.Path(path)
    if name == "":
        raise WrongUse("the name is empty; give 1 to 64 bytes, or None for the submission's own")
    try:
        if source.is_dir():
            _pack_folder(source, target, name)
        elif not source.is_file():
            raise WrongUse(f"{source}: there is no such folder or file")
        elif _is_tar(source):
            _pack_tar(source, target, name)
        elif _is_zip(source):
            _pack_zip(source, target, name, largest_bytes)
        else:
            _pack_program(source, target, name or source.name[:64])
        target.flush()
    except OSError as error:
        if error.errno in DISK_ERRORS:
            raise MyogradeError(f"{source}: can't be packed ({error.strerror}); see to the disk of "
                                f"{tempfile.gettempdir()} (TMPDIR)") from error
        raise WrongUse(f"{error.filename or source}: can't be packed ({error.strerror})") from error


def runtimes_of(path: str | os.PathLike[str]) -> list[str]:
    """The runtimes that the policy.json of a submission asks for; none if it can't be read here, which the server then
    reports."""
    source = pathlib.Path(path)
    try:
        manifest = json.loads(_manifest(source))
    except (OSError, KeyError, ValueError, tarfile.TarError, zipfile.BadZipFile):
        return []
    asked = manifest.get("runtimes") if isinstance(manifest, dict) else None
    if not isinstance(asked, list):
        return []
    return [name for name in asked if isinstance(name, str)]


def _head(source: pathlib.Path) -> bytes:
    with open(source, "rb") as stream:
        return stream.read(262)


def _is_tar(source: pathlib.Path) -> bool:
    """By its first bytes, as on the server, or by its name, so that the server reports what is wrong with it."""
    head = _head(source)
    return (head[257:] == b"ustar" or head.startswith(COMPRESSED)
            or source.name.lower().endswith(SENT_AS_THEY_ARE))


def _is_zip(source: pathlib.Path) -> bool:
    return _head(source).startswith(b"PK\3\4") or source.name.lower().endswith(".zip")


def _manifest(source: pathlib.Path) -> bytes:
    if source.is_dir():
        return (source / "policy.json").read_bytes()
    if _is_zip(source):
        with zipfile.ZipFile(source) as archive:
            return archive.read("policy.json")
    if _is_tar(source):
        with tarfile.open(source) as archive:
            for name in MANIFESTS:
                if name in archive.getnames():
                    file = archive.extractfile(name)
                    return file.read() if file is not None else b""
    return b"{}"


def _renamed(source: pathlib.Path, manifest: bytes, name: str) -> bytes:
    """A policy.json with another name."""
    try:
        about = json.loads(manifest)
    except ValueError as error:
        raise WrongUse(f"{source}: its policy.json is not JSON ({error})") from error
    if not isinstance(about, dict):
        raise WrongUse(f"{source}: its policy.json is not an object")
    return json.dumps({**about, "name": name}).encode()


def _pack_folder(folder: pathlib.Path, target: BinaryIO, new_name: str | None) -> None:
    if not (folder / "policy.json").is_file():
        raise WrongUse(f'{folder}: has no policy.json; add one such as {{"name": "my-policy", "command": '
                       '["python3", "policy.py"], "runtimes": ["python"]}')
    with _writer(target) as archive:
        for path in _below(folder):
            info = os.lstat(path)
            name = path.relative_to(folder).as_posix()
            if stat.S_ISLNK(info.st_mode):
                _add(archive, name, type=tarfile.SYMTYPE, linkname=os.readlink(path))
            elif stat.S_ISDIR(info.st_mode):
                _add(archive, name, type=tarfile.DIRTYPE, mode=0o755)
            elif name == "policy.json" and new_name is not None:
                _add(archive, name, _renamed(folder, path.read_bytes(), new_name))
            elif stat.S_ISREG(info.st_mode):
                _add_file(archive, name, path, info)
            else:
                raise WrongUse(f"{path}: is not a file, folder or symbolic link; remove it")


def _below(folder: pathlib.Path) -> list[pathlib.Path]:
    """Everything below a folder, by path; links are not followed."""
    found = []
    for root, folders, files in os.walk(folder, onerror=_raise):
        found += [pathlib.Path(root, name) for name in folders + files]
    return sorted(found)


def _raise(error: OSError) -> None:
    raise error


def _pack_program(program: pathlib.Path, target: BinaryIO, policy_name: str) -> None:
    info = os.stat(program)
    if not _head(program).startswith((b"\x7fELF", b"#!")):
        raise WrongUse(f"{program}: is not a program (neither ELF nor a script with \"#!\") and not an archive; give a "
                       "program, a folder with a policy.json, or an archive of one (.tar, .tar.gz, .tar.zst, "
                       ".tar.xz, .tar.bz2, .zip)")
    if not info.st_mode & 0o111:
        raise WrongUse(f"{program}: is not executable; set its bit with chmod +x")
    about = json.dumps({"name": policy_name, "command": [f"./{program.name}"]}).encode()
    with _writer(target) as archive:
        _add_file(archive, program.name, program, info)
        _add(archive, "policy.json", about)


def _pack_tar(file: pathlib.Path, target: BinaryIO, name: str | None) -> None:
    """Unchanged; if the name changes, an image goes beside a new policy.json, and another submission has the name in
    its policy.json changed."""
    if name is None:
        with open(file, "rb") as stream:
            shutil.copyfileobj(stream, target)
        return
    try:
        with tarfile.open(file) as source:
            if not any(known in source.getnames() for known in MANIFESTS):
                _pack_image(file, target, name)
                return
            with _writer(target) as archive:
                for entry in source:
                    content = source.extractfile(entry) if entry.isreg() else None
                    if content is not None and entry.name in MANIFESTS:
                        _add(archive, "policy.json", _renamed(file, content.read(), name))
                    else:
                        archive.addfile(entry, content)
    except (tarfile.TarError, EOFError) as error:
        raise WrongUse(f"{file}: can't be read here, so its name can't be changed ({error}); "
                       "put the name into its policy.json, or save an image uncompressed") from error


def _pack_image(file: pathlib.Path, target: BinaryIO, name: str) -> None:
    about = json.dumps({"name": name, "image": "image.tar"}).encode()
    with _writer(target) as archive:
        _add_file(archive, "image.tar", file, os.stat(file))
        _add(archive, "policy.json", about)


def _pack_zip(file: pathlib.Path, target: BinaryIO, new_name: str | None, largest_bytes: int | None) -> None:
    try:
        with zipfile.ZipFile(file) as source, _writer(target) as archive:
            # No file is unpacked beyond the size that the archive says it has.
            if largest_bytes is not None and sum(entry.file_size for entry in source.infolist()) > largest_bytes:
                raise WrongUse(f"{file}: unpacked, it has more than {largest_bytes} bytes; make it smaller")
            for entry in source.infolist():
                mode = entry.external_attr >> 16  # 0 if it was packed elsewhere than on Unix
                name = entry.filename.rstrip("/")
                if new_name is not None and name == "policy.json":
                    _add(archive, name, _renamed(file, source.read(entry), new_name))
                elif entry.is_dir():
                    _add(archive, name, type=tarfile.DIRTYPE, mode=0o755)
                elif stat.S_ISLNK(mode):
                    if entry.file_size > MAX_LINK_BYTES:
                        raise WrongUse(f"{file}: the target of the link {name[:80]} is too long")
                    _add(archive, name, type=tarfile.SYMTYPE,
                         linkname=source.read(entry).decode("utf-8"))
                else:
                    _add(archive, name, source.open(entry), size=entry.file_size, mode=_mode(mode))
    except (OSError, WrongUse):
        raise
    except Exception as error:  # whatever the decompressors of Python's library make of a broken archive
        raise WrongUse(f"{file}: can't be read as a zip archive ({error}); pack it again, without "
                       "a password") from error


def _writer(target: BinaryIO) -> tarfile.TarFile:
    return tarfile.open(fileobj=target, mode="w", format=tarfile.PAX_FORMAT)


def _mode(mode: int) -> int:
    return 0o755 if mode & 0o111 else 0o644


def _add_file(archive: tarfile.TarFile, name: str, path: pathlib.Path,
              info: os.stat_result) -> None:
    if info.st_mode & (stat.S_ISUID | stat.S_ISGID):
        raise WrongUse(f"{path}: has the setuid or setgid bit; remove it with chmod a-s")
    # Python uses a compiled module only while its source has the time that is recorded in it.
    with open(path, "rb") as stream:
        try:
            _add(archive, name, stream, size=info.st_size, mode=_mode(info.st_mode),
                 mtime=max(0, int(info.st_mtime)))
        except OSError as error:
            if error.filename is None and error.errno is None:  # tarfile's "unexpected end of data"
                raise WrongUse(f"{path}: changed while it was packed; try again") from error
            raise


def _add(archive: tarfile.TarFile, name: str, content: object = b"", **fields: object) -> None:
    entry = tarfile.TarInfo(name)
    if isinstance(content, bytes):
        entry.size, content = len(content), io.BytesIO(content)
    for field, value in fields.items():
        setattr(entry, field, value)
    archive.addfile(entry, content)  # type: ignore[arg-type]
