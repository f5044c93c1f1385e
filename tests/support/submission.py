"""Archives of submissions, valid and hostile."""

import io
import json
import tarfile

PROGRAM = b"#!/bin/sh\n"


def entry(name, content=b"", **fields):
    """An entry of an archive: its header, with `fields` of tarfile.TarInfo set, and its bytes."""
    info = tarfile.TarInfo(name)
    info.size = len(content)
    for key, value in fields.items():
        setattr(info, key, value)
    return info, content


def tar(entries, form=tarfile.PAX_FORMAT):
    """The bytes of an archive of these entries, in this order."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=form) as archive:
        for info, content in entries:
            archive.addfile(info, io.BytesIO(content))
    return out.getvalue()


def played_by_stand_in(mode, name="fake", program=PROGRAM):
    """A tar whose command tells fake_runner.py how to play. A different name or program makes a
    different artefact."""
    manifest = json.dumps({"name": name, "command": ["./policy", mode], "runtimes": []}).encode()
    return tar([entry("policy.json", manifest, mode=0o755), entry("policy", program, mode=0o755)])
