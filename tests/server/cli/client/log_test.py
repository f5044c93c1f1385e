"""How the command line tool fetches a log: in little memory, and completely or not at all.
usage: log_test.py BIN_DIR SOURCE_DIR"""
import hashlib
import json
import os
import struct
import sys
import threading
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, RESULT, CliCase, Handler, UnixServer, myograde)

CONTENT = b"a short log"
HASH = hashlib.sha256(CONTENT).hexdigest()
KIB = 1 << 10


def frame(content):
    """The simplest zstd: a header with the content's size, and one raw block, the last."""
    return (b"\x28\xb5\x2f\xfd\x20" + bytes([len(content)])
            + struct.pack("<I", len(content) << 3 | 1)[:3] + content)


class LogHandler(Handler):
    pieces = ()  # of the log's file
    missing = 0  # bytes that are announced but never sent

    def do_GET(self):
        if not self.path.startswith("/v1/logs/"):
            row = {"index": 0, "steps": 2, "log": {"sha256": HASH, "bytes": 11, "steps": 2}}
            answer = json.dumps({**RESULT, "episode_rows": [row]}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(sum(map(len, self.pieces)) + self.missing))
        self.end_headers()
        for piece in self.pieces:
            self.wfile.write(piece)
        self.close_connection = True


class LogTest(CliCase):
    def serve_log(self, *pieces, missing=0):
        path = self.path(f"s{len(os.listdir(self.temp))}")
        handler = type("LogsOf", (LogHandler,), {"pieces": pieces, "missing": missing})
        server = UnixServer(path, handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return path

    def get(self, socket, file):
        return myograde("episode", "log", "7", "--episode", "0", "-o", file, "--socket", socket)

    def test_a_log_is_unpacked_however_it_comes(self):
        packed = frame(CONTENT)
        for pieces in ([packed], [packed[i:i + 1] for i in range(len(packed))], [CONTENT]):
            file = self.path("log")
            done = self.get(self.serve_log(*pieces), file)
            self.assertEqual(done.returncode, 0, done.stderr)
            with open(file, "rb") as log:
                self.assertEqual(log.read(), CONTENT)
            self.assertEqual(os.stat(file).st_mode & 0o444, 0o444 & ~self.umask())
            os.remove(file)

    @staticmethod
    def umask():
        mask = os.umask(0)
        os.umask(mask)
        return mask

    def test_what_is_altered_or_cut_leaves_no_file(self):
        packed = frame(CONTENT)
        for status, sentence, pieces, missing in (
                (1, "episode 0: the log was altered", [frame(b"another log")], 0),
                (1, "is cut", [packed[:-2]], 0),
                (1, "can't be unpacked", [packed[:6] + b"\xff" * 20], 0),
                (3, "did not answer", [packed], 100),
                (3, "did not answer", [packed[:-2]], 2)):
            folder = self.path(f"out{len(os.listdir(self.temp))}")
            os.mkdir(folder)
            for old in (None, b"an older log"):
                file = f"{folder}/log"
                if old is not None:
                    with open(file, "wb") as log:
                        log.write(old)
                done = self.get(self.serve_log(*pieces, missing=missing), file)
                self.assertEqual(done.returncode, status, done.stderr)
                self.assertIn(sentence, done.stderr)
                self.assertEqual(os.listdir(folder), [] if old is None else ["log"])
                if old is not None:
                    with open(file, "rb") as log:
                        self.assertEqual(log.read(), old)

    def test_a_pipe_is_written_to_and_stays_one(self):
        pipe = self.path("pipe")
        os.mkfifo(pipe)
        found = []

        def read():
            with open(pipe, "rb") as end:
                found.append(end.read())
        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        done = self.get(self.serve_log(frame(CONTENT)), pipe)
        self.assertEqual(done.returncode, 0, done.stderr)
        reader.join(60)
        self.assertEqual(found, [CONTENT])

    def test_a_log_of_any_size_takes_little_memory(self):
        # Padding that a packer may put between two frames, and that unpackers skip.
        gap = 64 << 20
        skipped = struct.pack("<II", 0x184D2A50, gap) + bytes(gap)
        peaks = []
        for gaps in (1, 16):
            socket = self.serve_log(frame(b""), *[skipped] * gaps, frame(CONTENT))
            peaks.append(self.peak_of(socket, self.path(f"log{gaps}")))
            with open(self.path(f"log{gaps}"), "rb") as log:
                self.assertEqual(log.read(), CONTENT)
        self.assertLess(peaks[1] - peaks[0], 16 * KIB, "KiB")

    @staticmethod
    def peak_of(socket, file):
        """The tool's peak memory in KiB."""
        child = os.posix_spawn(f"{BIN_DIR}/myograde", [
            "myograde", "episode", "log", "7", "--episode", "0", "-o", file, "--socket", socket], os.environ)
        _, status, used = os.wait4(child, 0)
        assert status == 0, status
        return used.ru_maxrss


if __name__ == "__main__":
    unittest.main(argv=["log_test"])
