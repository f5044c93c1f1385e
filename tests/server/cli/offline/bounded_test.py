"""Untrusted files that are far too large, or become so when unpacked: each is rejected in one
sentence, using no more memory than a valid file takes.
usage: bounded_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

BIN_DIR, SOURCE_DIR = sys.argv[1:3]
GIB = 1 << 30
# More than the program takes for doing nothing; unbounded parsing takes 1 GiB and more.
MOST_MIB = 250
KEY = ("-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEAGb9ECWmEzf6FQbrBZ9w7lshQhqowtrbLDFw4rXAxZuE=\n"
       "-----END PUBLIC KEY-----\n")
RECEIPT = '{"receipt":{"episodes":[],"format":1,"grader":{}},"signature":{}}\n'


def run(*words):
    """Exit status, output and peak memory (MiB) of the command line tool."""
    environment = dict(os.environ, MYOGRADE_CONFIG_DIR=f"{SOURCE_DIR}/configs",
                       # Memory that a sanitizer quarantines is not the program's.
                       ASAN_OPTIONS="quarantine_size_mb=1:thread_local_quarantine_size_kb=64")
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen([f"{BIN_DIR}/myograde", *map(str, words)], env=environment,
                                   stdin=subprocess.DEVNULL, stdout=out, stderr=out)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        return process.returncode, out.read().decode(), usage.ru_maxrss / 1024


class Bounded(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="bounded-")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.base = run("--version")[2]
        with open(f"{SOURCE_DIR}/configs/reference/manipulation.lcmlog.zst", "rb") as file:
            cls.log = subprocess.run(["zstd", "-dc"], stdin=file, capture_output=True,
                                     check=True).stdout

    def path(self, name, content=b"", size=None):
        path = f"{self.folder}/{name}"
        with open(path, "wb") as file:
            file.write(content)
            if size is not None:
                file.truncate(size)  # zeros that take no space
        return path

    def packed(self, name, start, kind):
        """Packs `start` followed by a gibibyte of zeros, or of the log's own steps repeated."""
        path = f"{self.folder}/{name}"
        block = bytes(1 << 20) if kind == "zeros" else (self.log[-4096:] * 256)
        with open(path, "wb") as file:
            packer = subprocess.Popen(["zstd", "-1", "-c"], stdin=subprocess.PIPE, stdout=file)
            packer.stdin.write(start)
            for _ in range(GIB // len(block)):
                packer.stdin.write(block)
            packer.stdin.close()
            self.assertEqual(packer.wait(), 0)
        self.assertLess(os.path.getsize(path), 64 << 20)
        return path

    def refused(self, *words, sentence, status):
        found, text, memory = run(*words)
        self.assertEqual(found, status, text)
        self.assertIn(sentence, text)
        self.assertNotIn("terminate", text)
        self.assertLess(memory - self.base, MOST_MIB, words)

    def header(self):
        name, size = struct.unpack(">II", self.log[20:28])
        return self.log[:28 + name + size]

    def test_receipts(self):
        key = self.path("key.pem", KEY.encode())
        for receipt, sentence, status in (
                (self.path("zeros", size=GIB), "larger than 16777216 bytes, so it is not a receipt", 2),
                (self.path("long", RECEIPT.encode(), size=GIB), "so it is not a receipt", 2),
                (self.path("values", RECEIPT.replace("[]", "[" + "0," * 7_000_000 + "0]").encode()),
                 "it holds more than any evaluation has", 1),
                ("/dev/zero", "is a device", 2)):
            self.refused("verify", receipt, "--key", key, sentence=sentence, status=status)

    def test_logs(self):
        header = self.header()
        key = self.path("key.pem", KEY.encode())
        receipt = self.path("receipt.json", RECEIPT.encode())
        for name, log, sentence in (
                ("zeros", self.path("zeros.lcmlog", size=GIB), "the file is not a log"),
                ("endless", "/dev/zero", "is a device"),
                ("bomb", self.packed("bomb.zst", b"", "zeros"), "the file is not a log"),
                ("header", self.path("header.lcmlog", header, size=GIB), "the log is larger than"),
                ("header and bomb", self.packed("header.zst", header, "zeros"),
                 "the log is larger than"),
                ("header and steps", self.packed("steps.zst", header, "steps"),
                 "the log is larger than"),
                ("long header", self.path("long.lcmlog", header[:24] + b"\xff\xff\xff\xff", size=GIB),
                 "too long for the header of a log")):
            with self.subTest(name):
                self.refused("episode", "replay", log, sentence=sentence, status=2 if name == "endless" else 1)
                self.refused("verify", receipt, "--key", key, "--logs", log, sentence=sentence,
                             status=1)

    def test_what_is_no_file_is_refused_at_once(self):
        pipe, cup = f"{self.folder}/pipe", f"{self.folder}/cup.json"
        os.mkfifo(pipe)
        os.mkfifo(cup)
        status, text, _ = run("phase", "check", cup)
        self.assertNotEqual(status, 0)
        self.assertIn("a named pipe", text)
        receipt = self.path("some-receipt.json", RECEIPT.encode())
        key = self.path("some-key.pem", KEY.encode())
        for what, path in (("a named pipe", pipe), ("a folder", self.folder), ("a device", "/dev/zero")):
            for words in (("episode", "replay", path), ("store", "import", path), ("verify", path, "--key", key),
                          ("verify", receipt, "--key", path), ("episode", "render", path, "-o", f"{pipe}.png"),
                          ("local", "/bin/true", "--track", "elbow", "--seeds", path)):
                with self.subTest(what, words=words):
                    status, text, _ = run(*words)
                    (self.assertEqual if words[1] == "replay" else self.assertGreaterEqual)(status, 2, text)
                    self.assertIn(what, text)

    def test_a_window_larger_than_a_log_is_not_set_up(self):
        path = f"{self.folder}/window.zst"
        with open(path, "wb") as file:
            subprocess.run(["zstd", "-c", "--ultra", "-22", "--zstd=wlog=31", "--long=31"],
                           input=self.log, stdout=file, stderr=subprocess.DEVNULL, check=True)
        self.assertLess(run("episode", "replay", path)[2] - self.base, MOST_MIB)

    def test_imports(self):
        for name, content, sentence in (
                ("line", b"", "line 1: is too long"),
                ("second", b'{"data":{\n"team":[\n', "line 3: is too long"),
                ("deep", b'{"data":{\n"team":[\n' + b"[" * 8_000_000 + b"\n", "is not what an export has")):
            file = self.path(f"{name}.json", content, size=None if name == "deep" else GIB)
            self.refused("store", "import", file, "--data", f"{self.folder}/data", sentence=sentence,
                         status=2)
        tables = self.path("tables.json", b'{"data":{\n' + b"".join(
            b'"%d":[\n],\n' % i for i in range(200_000)))
        self.refused("store", "import", tables, "--data", f"{self.folder}/data",
                     sentence="is one table too many", status=2)

    def test_an_honest_log_is_read_as_before(self):
        status, text, _ = run("episode", "log", "--help")
        self.assertEqual(status, 0, text)
        cut = self.path("cut.lcmlog", self.log[:-10])
        self.refused("episode", "replay", cut, sentence="the file is cut or altered", status=1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
