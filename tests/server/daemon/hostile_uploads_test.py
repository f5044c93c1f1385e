"""Hostile archives, sent to the real daemon and given to the real command line tool: each is
rejected with one sentence, nothing of it is left, and the daemon goes on."""

import gzip
import os
import tarfile
import time
import unittest

from daemon_test import BIN, DaemonCase
from support.proc import memory_bytes
from support.submission import PROGRAM, entry, played_by_stand_in, tar

MANIFEST = b'{"name": "hostile", "command": ["./policy"]}'
# An upload is rejected long before this; without limits these would take minutes.
SOON_S = 30


def packed(*extra, honest=True):
    """A tar of a valid submission with entries added."""
    good = [entry("policy.json", MANIFEST), entry("policy", PROGRAM, mode=0o755)]
    return tar([*(good if honest else ()), *extra])


def claim(size):
    """A tar whose last header claims more bytes than follow."""
    header = tarfile.TarInfo("claim")
    header.size = size
    return packed()[:4 * 512] + header.tobuf(tarfile.GNU_FORMAT)


def hungry():
    """The map of a sparse file: a few kilobytes that take a gigabyte of memory."""
    body = b"20000000\n" + b"0\n0\n" * 20_000_000
    info = tarfile.TarInfo("holes")
    info.pax_headers = {"GNU.sparse.major": "1", "GNU.sparse.minor": "0",
                        "GNU.sparse.name": "holes", "GNU.sparse.realsize": "1000"}
    info.size = len(body)
    return gzip.compress(packed((info, body)), 1)


def many():
    """Ten million entries in less than a megabyte."""
    header = tarfile.TarInfo("./")
    header.type = tarfile.DIRTYPE
    part = gzip.compress(header.tobuf() * 100_000)
    return part * 100


SYMLINK = {"type": tarfile.SYMTYPE, "linkname": "/tmp"}
HOSTILE = {
    "traversal": (packed(entry("../evil", b"x")), '".." in its path'),
    "absolute": (packed(entry("/tmp/evil", b"x")), "absolute path"),
    "setuid": (packed(entry("su", b"x", mode=0o4755)), "setuid"),
    "hardlink": (packed(entry("h", type=tarfile.LNKTYPE, linkname="policy")), "hard link"),
    "device": (packed(entry("d", type=tarfile.CHRTYPE)), "device node"),
    "fifo": (packed(entry("p", type=tarfile.FIFOTYPE)), "named pipe"),
    "link-out": (packed(entry("l", type=tarfile.SYMTYPE, linkname="../../x")), 'targets with ".."'),
    "through-link": (packed(entry("d", **SYMLINK), entry("d/evil", b"x")), "which is not a folder"),
    "newline": (packed(entry("a\nb", b"x")), "control character"),
    "twice": (packed(entry("policy", b"x")), "appears twice"),
    "no-manifest": (packed(entry("policy", b"x"), honest=False), "no policy.json"),
    "claim": (claim(10 << 30), "larger than"),
    "bomb": (gzip.compress(packed(entry("zeros", bytes(32 << 20)))), "larger than"),
    "gzip-twice": (gzip.compress(gzip.compress(packed())), "compressed more than once"),
    "ten-million": (many(), "more than 1000 files"),
    "cut": (packed()[:1300], "broken"),
    "nonsense": (b"no archive at all" * 100, "archive of a supported kind"),
    "empty": (bytes(1024), ""),
}


class HostileUploads(DaemonCase):
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
        self.assertTrue(self.daemon.running)

    def most_memory(self):
        return memory_bytes(self.daemon.pid, "VmHWM")

    def test_each_is_refused_and_leaves_nothing(self):
        before = self.most_memory()
        for name, (content, sentence) in HOSTILE.items():
            with self.subTest(name):
                status, body = self.upload(content)
                self.assertEqual(status, 400, body)
                self.assertEqual(body["error"]["code"], "bad_artefact")
                self.assertIn(sentence, body["error"]["message"])
                self.assertNotIn("\n", body["error"]["message"])
                self.check_nothing_left()
        self.assertLess(self.most_memory() - before, 200 << 20)
        status, body = self.upload(played_by_stand_in("good"))
        self.assertEqual(status, 201, body)

    def test_what_takes_all_memory_ends_alone(self):
        with open(BIN / "myograded", "rb") as file:
            if b"__asan_init" in file.read():
                self.skipTest("a sanitizer's build can't limit its address space")
        before = self.most_memory()
        status, body = self.upload(hungry())
        self.assertEqual((status, body["error"]["code"]), (400, "bad_artefact"), body)
        self.check_nothing_left()
        self.assertLess(self.most_memory() - before, 200 << 20)

    def test_the_command_line_refuses_them_too(self):
        # The tool checks with a track's own limits, which are wider than this daemon's.
        for name in ("traversal", "setuid", "device", "twice", "gzip-twice", "claim", "cut"):
            content, sentence = HOSTILE[name]
            path = self.folder / f"{name}.tar"
            path.write_bytes(content)
            with self.subTest(name):
                done = self.daemon.cli("submit", path, "--track", "demo-manipulation", "--team",
                                       "t", check=False)
                self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
                self.assertIn(sentence, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
                self.check_nothing_left()


if __name__ == "__main__":
    unittest.main(verbosity=2)
