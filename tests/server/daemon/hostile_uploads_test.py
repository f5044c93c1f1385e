"""Archives made to do harm, sent to the real daemon and handed to the real command line tool: each
is refused with one sentence, nothing of it is left, and the daemon goes on."""

import gzip
import io
import os
import subprocess
import tarfile
import time
import unittest

import daemon_test

BIN = daemon_test.BIN
MANIFEST = b'{"name": "hostile", "command": ["./policy"]}'
# An upload is refused long before this; without limits these would take minutes.
SOON_S = 30


def entry(name, content=b"", **fields):
    info = tarfile.TarInfo(name)
    info.size = len(content)
    for key, value in fields.items():
        setattr(info, key, value)
    return info, content


def tar(*extra, honest=True):
    """A tar of an honest submission with entries added."""
    entries = list(extra)
    if honest:
        entries[:0] = [entry("policy.json", MANIFEST), entry("policy", b"#!/bin/sh\n", mode=0o755)]
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for info, content in entries:
            archive.addfile(info, io.BytesIO(content))
    return out.getvalue()


def claim(size):
    """A tar whose last header claims bytes that are not there."""
    header = tarfile.TarInfo("claim")
    header.size = size
    return tar()[:4 * 512] + header.tobuf(tarfile.GNU_FORMAT)


def hungry():
    """The map of a sparse file: some kilobytes that take a gigabyte of memory."""
    body = b"20000000\n" + b"0\n0\n" * 20_000_000
    info = tarfile.TarInfo("holes")
    info.pax_headers = {"GNU.sparse.major": "1", "GNU.sparse.minor": "0",
                        "GNU.sparse.name": "holes", "GNU.sparse.realsize": "1000"}
    info.size = len(body)
    return gzip.compress(tar((info, body)), 1)


def many():
    """Ten million entries in less than a megabyte."""
    header = tarfile.TarInfo("./")
    header.type = tarfile.DIRTYPE
    part = gzip.compress(header.tobuf() * 100_000)
    return part * 100


SYMLINK = {"type": tarfile.SYMTYPE, "linkname": "/tmp"}
HOSTILE = {
    "traversal": (tar(entry("../evil", b"x")), '".." in its path'),
    "absolute": (tar(entry("/tmp/evil", b"x")), "absolute path"),
    "setuid": (tar(entry("su", b"x", mode=0o4755)), "setuid"),
    "hardlink": (tar(entry("h", type=tarfile.LNKTYPE, linkname="policy")), "hard link"),
    "device": (tar(entry("d", type=tarfile.CHRTYPE)), "device node"),
    "fifo": (tar(entry("p", type=tarfile.FIFOTYPE)), "named pipe"),
    "link-out": (tar(entry("l", type=tarfile.SYMTYPE, linkname="../../x")), 'targets with ".."'),
    "through-link": (tar(entry("d", **SYMLINK), entry("d/evil", b"x")), "which is no folder"),
    "newline": (tar(entry("a\nb", b"x")), "control character"),
    "twice": (tar(entry("policy", b"x")), "is there twice"),
    "no-manifest": (tar(entry("policy", b"x"), honest=False), "no policy.json"),
    "claim": (claim(10 << 30), "larger than"),
    "bomb": (gzip.compress(tar(entry("zeros", bytes(32 << 20)))), "larger than"),
    "gzip-twice": (gzip.compress(gzip.compress(tar())), "compressed more than once"),
    "ten-million": (many(), "more than 1000 files"),
    "cut": (tar()[:1300], "broken"),
    "nonsense": (b"no archive at all" * 100, "archive of a kind that is accepted"),
    "empty": (bytes(1024), ""),
}


class HostileUploads(daemon_test.DaemonCase):
    def start(self):
        self.configure(artefacts={"bytes": 1 << 20, "files": 1000,
                                  "unpack_memory_bytes": 256 << 20})
        return super().start()

    def upload(self, content):
        begun = time.monotonic()
        status, body = self.call("POST", "/v1/artefacts", content)
        self.assertLess(time.monotonic() - begun, SOON_S)
        return status, body

    def check_nothing_left(self):
        self.assertEqual(os.listdir(self.data / "spool"), [])
        self.assertEqual(os.listdir(self.data / "artefacts"), [])
        self.assertFalse(os.path.exists("/tmp/evil"))
        self.assertEqual(self.get("/v1/submissions")["submissions"], [])
        self.assertIsNone(self.daemon.poll())

    def resident_kib(self):
        with open(f"/proc/{self.daemon.pid}/status", encoding="ascii") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))

    def test_each_is_refused_and_leaves_nothing(self):
        before = self.resident_kib()
        for name, (content, sentence) in HOSTILE.items():
            with self.subTest(name):
                status, body = self.upload(content)
                self.assertEqual(status, 400, body)
                self.assertEqual(body["error"]["code"], "bad_artefact")
                self.assertIn(sentence, body["error"]["message"])
                self.assertNotIn("\n", body["error"]["message"])
                self.check_nothing_left()
        self.assertLess(self.resident_kib() - before, 200 << 10)
        status, body = self.upload(daemon_test.archive("good"))
        self.assertEqual(status, 201, body)

    def test_what_takes_all_memory_ends_alone(self):
        with open(BIN / "myograded", "rb") as file:
            if b"__asan_init" in file.read():
                self.skipTest("a sanitizer's build can't limit its address space")
        before = self.resident_kib()
        status, body = self.upload(hungry())
        self.assertEqual((status, body["error"]["code"]), (400, "bad_artefact"), body)
        self.check_nothing_left()
        self.assertLess(self.resident_kib() - before, 200 << 10)

    def test_the_command_line_refuses_them_too(self):
        # The tool checks with a track's own limits, which are wider than this daemon's.
        for name in ("traversal", "setuid", "device", "twice", "gzip-twice", "claim", "cut"):
            content, sentence = HOSTILE[name]
            path = self.folder / f"{name}.tar"
            path.write_bytes(content)
            with self.subTest(name):
                done = subprocess.run(
                    [BIN / "myograde", "submit", path, "--track", "demo-manipulation",
                     "--team", "t", "--data", self.data],
                    capture_output=True, text=True, timeout=60, check=False,
                    env=dict(os.environ, MYOGRADE_CONFIG_DIR=str(self.configs)))
                self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
                self.assertIn(sentence, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
                self.check_nothing_left()


if __name__ == "__main__":
    unittest.main(verbosity=2)
