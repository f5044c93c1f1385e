"""A crowd of clients that connect to a daemon's socket, send something, and hold on to it."""

import contextlib
import subprocess
import sys

# Becomes another user if asked to; "slow" sends a little more from time to time.
_PROGRAM = r"""
import os, socket, sys, time
path, uid, count, text = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), bytes.fromhex(sys.argv[4])
if uid >= 0:
    os.setgid(uid); os.setuid(uid)
clients = []
for _ in range(count):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(60)
    try:
        client.connect(path)
        client.sendall(text)
    except PermissionError:
        sys.exit("may not connect")
    except OSError:
        pass  # it was asked to go
    clients.append(client)
print("there", flush=True)
while True:
    time.sleep(0.2)
    for client in clients if "slow" in sys.argv else ():
        try:
            client.send(b"x" * 2000)
        except OSError:
            pass
"""

# The head of an upload of this many bytes, and the first of them.
UPLOAD = b"POST /v1/artefacts HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\nx"


@contextlib.contextmanager
def crowd(path, count, text=b"", uid=None, slow=False):
    """`count` clients of the socket at `path`, connected when this yields, killed afterwards. Each
    sends `text`, and then nothing, or if `slow`, a little from time to time. With a `uid` they run
    as that user, which only root can do. OSError if they may not connect."""
    process = subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, str(path), str(-1 if uid is None else uid), str(count),
         text.hex()] + ["slow"] * slow, stdout=subprocess.PIPE)
    try:
        if process.stdout.readline() != b"there\n":
            raise OSError(f"a crowd of {count} could not connect to {path}")
        yield
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
