"""Archives that must be refused at submission: name -> the file's bytes. Everything that would
escape is called redteam-escaped, so that it can be looked for."""

import gzip
import io
import shutil
import subprocess
import tarfile
import zipfile

ESCAPED = "redteam-escaped"
MANIFEST = b'{"name": "archive", "command": ["./run"]}'
BOMB_BYTES = 100 << 20  # more than the suite's daemon takes unpacked
MANY_ENTRIES = 3000     # likewise
GOOD = (("policy.json", MANIFEST, 0o644), ("run", b"#!/bin/sh\n", 0o755))


def _entry(name, mode=0o644, kind=tarfile.REGTYPE, target=""):
    info = tarfile.TarInfo(name)
    info.mode, info.type, info.linkname = mode, kind, target
    if kind in (tarfile.CHRTYPE, tarfile.BLKTYPE):
        info.devmajor, info.devminor = 1, 1
    return info


def _tar(*further, good=GOOD, kind=tarfile.PAX_FORMAT):
    """An archive of an honest submission and what else: (info, bytes)."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=kind) as archive:
        for name, content, mode in good:
            info = _entry(name, mode)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
        for info, content in further:
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return packed.getvalue()


def _zip(*further):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content, mode in (*GOOD, *further):
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return packed.getvalue()


def _claims_10_gb():
    """A header that claims 10 GB, and no bytes behind it."""
    huge = _entry("huge")
    huge.size = 10 * 10**9
    return _tar()[:-10240] + huge.tobuf(tarfile.GNU_FORMAT) + b"\0" * 512


def _through_link():
    return _tar((_entry("way", kind=tarfile.SYMTYPE, target="/tmp"), b""),
                (_entry(f"way/{ESCAPED}"), b"x"))


def good():
    return {"plain.tar": _tar(), "packed.tar.gz": gzip.compress(_tar()), "packed.zip": _zip()}


def _tars():
    bomb = _tar((_entry("zeros"), b"\0" * BOMB_BYTES))
    many = _tar(*((_entry(f"many/{i}"), b"") for i in range(MANY_ENTRIES)))
    link = {"kind": tarfile.SYMTYPE}
    files = {
        "bomb.tar.gz": gzip.compress(bomb, 6),
        "many.tar.gz": gzip.compress(many, 1),
        "claim.tar": _claims_10_gb(),
        "up.tar": _tar((_entry(f"../{ESCAPED}"), b"x")),
        "inner-up.tar": _tar((_entry(f"a/b/../../../{ESCAPED}"), b"x")),
        "absolute.tar": _tar((_entry(f"/tmp/{ESCAPED}"), b"x")),
        "setuid.tar": _tar((_entry("tool", 0o4755), b"x")),
        "setgid.tar": _tar((_entry("tool", 0o2755), b"x")),
        "hard-link.tar": _tar((_entry("passwd", kind=tarfile.LNKTYPE, target="/etc/passwd"), b"")),
        "hard-link-inside.tar": _tar((_entry("two", kind=tarfile.LNKTYPE, target="run"), b"")),
        "device.tar": _tar((_entry("mem", 0o666, tarfile.CHRTYPE), b"")),
        "block.tar": _tar((_entry("disk", 0o666, tarfile.BLKTYPE), b"")),
        "pipe.tar": _tar((_entry("pipe", kind=tarfile.FIFOTYPE), b"")),
        "link-up.tar": _tar((_entry("up", target="../../../etc", **link), b"")),
        "through-link.tar": _through_link(),
        "twice.tar": _tar((_entry("run", 0o755), b"#!/bin/false\n")),
        "twice-as-folder.tar": _tar((_entry("run", 0o755, tarfile.DIRTYPE), b"")),
        "newline.tar": _tar((_entry("new\nline"), b"x")),
        "escape-codes.tar": _tar((_entry("\x1b[2Jname"), b"x")),
        "no-utf8.tar": _tar((_entry("A\udcff\udcfeA"), b"x"), kind=tarfile.GNU_FORMAT),
        "damaged.tar": _tar((_entry("AAAA"), b"x")).replace(b"AAAA\0", b"BAAA\0"),
        "long-name.tar": _tar((_entry("n" * 300), b"x")),
        "deep.tar": _tar((_entry("d/" * 100 + "x"), b"x")),
        "manifest-is-link.tar": _tar(
            (_entry("policy.json", target="/etc/passwd", **link), b""), good=GOOD[1:]),
        "program-is-loop.tar": _tar((_entry("run", target="run", **link), b""), good=GOOD[:1]),
        "no-manifest.tar": _tar(good=GOOD[1:]),
        "no-program.tar": _tar(good=GOOD[:1]),
        "cut.tar": _tar((_entry("data"), b"x" * 5000))[:5000],
        "garbage.tar": b"this is no archive" * 100,
        "empty.tar": b"",
    }
    if shutil.which("zstd"):
        files["bomb.tar.zst"] = subprocess.run(["zstd", "-q", "-c"], input=bomb, check=True,
                                               stdout=subprocess.PIPE).stdout
    return files


def _zips():
    return {
        "bomb.zip": _zip(("zeros", b"\0" * BOMB_BYTES, 0o644)),
        "many.zip": _zip(*((f"many/{i}", b"", 0o644) for i in range(MANY_ENTRIES))),
        "up.zip": _zip((f"../{ESCAPED}", b"x", 0o644)),
        "absolute.zip": _zip((f"/tmp/{ESCAPED}", b"x", 0o644)),
        "link-up.zip": _zip(("up", b"../../etc", 0o120777)),
        "setuid.zip": _zip(("tool", b"x", 0o104755)),
    }


def bad():
    return {**_tars(), **_zips()}
