#!/usr/bin/python3
"""Puts the licences of what a wheel of the Python package brings into it, below its licenses/third-party:
of the libraries that auditwheel copied, and of what is compiled into the extension. The same wheel and
Debian packages give the same bytes."""

from __future__ import annotations

import argparse
import base64
import hashlib
import os
import pathlib
import re
import sys
import tempfile
import zipfile

import components
import texts
from components import Trouble

SOURCE = pathlib.Path(__file__).resolve().parents[2]
EXAMPLE = """example:
  docker/sbom/wheel_licences.py myograde-1.0.0-cp311-cp311-manylinux_2_35_x86_64.whl --extension _environments.so"""
LIBRARY = re.compile(r"^[\w.]+\.libs/([^/]+)$")
DIGEST = re.compile(r"-[0-9a-f]{8}(?=\.so)")  # by which auditwheel tells copies apart


def record_line(name: str, data: bytes) -> str:
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(data)}"


def rewrite(wheel: pathlib.Path, added: dict[str, bytes]) -> None:
    """Adds these files below dist-info to the wheel and its list."""
    whole = wheel.with_name(wheel.name + ".new")
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as new:
        (record,) = [entry for entry in old.infolist() if entry.filename.endswith(".dist-info/RECORD")]
        about = record.filename.removesuffix("RECORD")
        lines = [line for line in old.read(record).decode().splitlines()
                 if not line.startswith(f"{about}licenses/third-party/")]
        for entry in old.infolist():
            if entry is not record and not entry.filename.startswith(f"{about}licenses/third-party/"):
                new.writestr(entry, old.read(entry))
        for name in sorted(added):
            entry = zipfile.ZipInfo(f"{about}licenses/third-party/{name}", record.date_time)
            entry.external_attr, entry.compress_type = 0o100644 << 16, zipfile.ZIP_DEFLATED
            new.writestr(entry, added[name])
            lines.insert(-1, record_line(entry.filename, added[name]))
        new.writestr(record, "\n".join(lines) + "\n")
    whole.replace(wheel)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, epilog=EXAMPLE,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("--extension", type=pathlib.Path, required=True,
                        help="the extension as it was linked, before auditwheel copied its libraries")
    parser.add_argument("--cache", type=pathlib.Path, default=os.environ.get("MYOGRADE_CACHE"),
                        help="folder that ./dev setup filled, with the wheels' licences (default: MYOGRADE_CACHE)")
    words = parser.parse_args()
    try:
        with zipfile.ZipFile(words.wheel) as archive:
            libraries = {DIGEST.sub("", match[1]) for match in map(LIBRARY.match, archive.namelist()) if match}
        found = components.in_wheel(SOURCE, words.extension, libraries)
        with tempfile.TemporaryDirectory() as folder:
            target = pathlib.Path(folder)
            texts.write(found, target, words.cache, SOURCE)
            rewrite(words.wheel, {path.relative_to(target).as_posix(): path.read_bytes()
                                  for path in target.rglob("*") if path.is_file()})
    except (Trouble, OSError, zipfile.BadZipFile) as error:
        print(f"error: {error}", file=sys.stderr)
        return 4
    print(f"{words.wheel.name} brings the licences of {', '.join(one.name for one in found)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
