"""Archives that must be rejected at submission: name -> the file's bytes. Everything that would
escape is called redteam-escaped, so that it can be searched for."""

import gzip
import io
import shutil
import subprocess
import tarfile
import zipfile

from support.submission import entry, tar

ESCAPED = "redteam-escaped"
MANIFEST = b'{"name": "archive", "command": ["./run"]}'
BOMB_BYTES = 100 << 20  # more than the suite's daemon takes unpacked
MANY_ENTRIES = 3000     # likewise
GOOD = (("policy.json", MANIFEST, 0o644), ("run", b"#!/bin/sh\n", 0o755))


def _tar(*further, good=GOOD, form=tarfile.PAX_FORMAT):
    """An archive of a valid submission plus other entries."""
    return tar([entry(name, content, mode=mode) for name, content, mode in good] + [*further],
               form)


def _link(name, target, kind=tarfile.SYMTYPE):
    return entry(name, type=kind, linkname=target)


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
    """A header that claims 10 GB, without any content."""
    huge = tarfile.TarInfo("huge")
    huge.size = 10 * 10**9
    return _tar()[:-10240] + huge.tobuf(tarfile.GNU_FORMAT) + b"\0" * 512


def _through_link():
    return _tar(_link("way", "/tmp"), entry(f"way/{ESCAPED}", b"x"))


def good():
    return {"plain.tar": _tar(), "packed.tar.gz": gzip.compress(_tar()), "packed.zip": _zip()}


def _tars():
    bomb = _tar(entry("zeros", b"\0" * BOMB_BYTES))
    many = _tar(*(entry(f"many/{i}") for i in range(MANY_ENTRIES)))
    device = {"devmajor": 1, "devminor": 1}
    files = {
        "bomb.tar.gz": gzip.compress(bomb, 6),
        "many.tar.gz": gzip.compress(many, 1),
        "claim.tar": _claims_10_gb(),
        "up.tar": _tar(entry(f"../{ESCAPED}", b"x")),
        "inner-up.tar": _tar(entry(f"a/b/../../../{ESCAPED}", b"x")),
        "absolute.tar": _tar(entry(f"/tmp/{ESCAPED}", b"x")),
        "setuid.tar": _tar(entry("tool", b"x", mode=0o4755)),
        "setgid.tar": _tar(entry("tool", b"x", mode=0o2755)),
        "hard-link.tar": _tar(_link("passwd", "/etc/passwd", tarfile.LNKTYPE)),
        "hard-link-inside.tar": _tar(_link("two", "run", tarfile.LNKTYPE)),
        "device.tar": _tar(entry("mem", mode=0o666, type=tarfile.CHRTYPE, **device)),
        "block.tar": _tar(entry("disk", mode=0o666, type=tarfile.BLKTYPE, **device)),
        "pipe.tar": _tar(entry("pipe", type=tarfile.FIFOTYPE)),
        "link-up.tar": _tar(_link("up", "../../../etc")),
        "through-link.tar": _through_link(),
        "twice.tar": _tar(entry("run", b"#!/bin/false\n", mode=0o755)),
        "twice-as-folder.tar": _tar(entry("run", mode=0o755, type=tarfile.DIRTYPE)),
        "newline.tar": _tar(entry("new\nline", b"x")),
        "escape-codes.tar": _tar(entry("\x1b[2Jname", b"x")),
        "no-utf8.tar": _tar(entry("A\udcff\udcfeA", b"x"), form=tarfile.GNU_FORMAT),
        "damaged.tar": _tar(entry("AAAA", b"x")).replace(b"AAAA\0", b"BAAA\0"),
        "long-name.tar": _tar(entry("n" * 300, b"x")),
        "deep.tar": _tar(entry("d/" * 100 + "x", b"x")),
        "manifest-is-link.tar": _tar(_link("policy.json", "/etc/passwd"), good=GOOD[1:]),
        "program-is-loop.tar": _tar(_link("run", "run"), good=GOOD[:1]),
        "no-manifest.tar": _tar(good=GOOD[1:]),
        "no-program.tar": _tar(good=GOOD[:1]),
        "cut.tar": _tar(entry("data", b"x" * 5000))[:5000],
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
