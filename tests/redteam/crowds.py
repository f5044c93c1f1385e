"""Cases 85 and 86: clients of the API that break no rule and want to freeze it or fill its queue. An
organiser and an honest submission are served all the same, and so is the user whose crowd it is.
Where root runs the daemon, the crowd is another user's, as limits are each user's own, and that user
asks too; else the crowd, the organiser and the honest one are all the same ordinary user."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time

from host import ApiError

SOON_S = 30
UPLOAD = b"POST /v1/artefacts HTTP/1.1\r\nContent-Length: %d\r\n\r\nx"
# Name, how many, and what each says before it falls silent.
CROWDS = (
    ("silent uploads", 70, UPLOAD % 1000),
    ("slow uploads", 80, UPLOAD % (1 << 20)),
    ("announced gigabytes", 80, UPLOAD % (4 << 30)),
    ("idle connections", 300, b""),
    ("half heads", 300, b"GET /v1/hea"),
    ("half chunks", 300, b"POST /v1/submissions HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nf"),
    ("answers that nobody reads", 300, b"GET /v1/tracks HTTP/1.1\r\n\r\n" * 200),
    ("broken heads", 300, b"GET / HTTP/1.1\n\n\0\xff" * 50),
)


STRANGER = 61990
# Becomes the crowd's user, connects and speaks; "slow" adds a little from time to time.
CROWD = r"""
import os, socket, sys, time
path, count, text = sys.argv[1], int(sys.argv[2]), bytes.fromhex(sys.argv[3])
if os.geteuid() == 0:
    os.setgid(int(sys.argv[4])); os.setuid(int(sys.argv[4]))
clients = []
for _ in range(count):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(30)
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
            client.send(b"x" * 3000)
        except OSError:
            pass
"""


# Asks once as the crowd's user, and prints the answer's status.
ASK = r"""
import http.client, os, socket, sys
os.setgid(int(sys.argv[2])); os.setuid(int(sys.argv[2]))
connection = http.client.HTTPConnection("myograde", timeout=60)
connection.sock = socket.socket(socket.AF_UNIX)
connection.sock.settimeout(60)
connection.sock.connect(sys.argv[1])
connection.request("GET", "/v1/health")
print(connection.getresponse().status)
"""


def _crowds_user(host):
    """An ordinary daemon's own, as nobody else may talk to it."""
    return STRANGER if host.user is None else host.user


@contextlib.contextmanager
def _open_to_all(host):
    """The socket and the way to it, for as long as the crowds are there."""
    if os.geteuid() != 0 or host.user is not None:
        yield
        return
    modes = [(path, path.stat().st_mode & 0o7777)
             for path in (host.root, host.data, host.data / "myograde.sock")]
    for (path, _), mode in zip(modes, (0o711, 0o711, 0o666)):
        path.chmod(mode)
    try:
        yield
    finally:
        for path, mode in modes:
            path.chmod(mode)


@contextlib.contextmanager
def _crowd(host, name, count, text):
    process = subprocess.Popen(
        [sys.executable, "-c", CROWD, host.data / "myograde.sock", str(count), text.hex(),
         str(_crowds_user(host))] + ["slow"] * (name == "slow uploads"), stdout=subprocess.PIPE)
    try:
        if process.stdout.readline() != b"there\n":
            raise OSError(f"{name}: the crowd could not connect")
        yield
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def _answers(host, name, begun):
    """What an organiser and the crowd's own user find amiss while the crowd is there."""
    try:
        if host.get("/v1/health")["status"] != "ok":
            yield f"{name}: the daemon is not well"
        done = host.cli("submit", host.root / "absent", "--track", "rt", "--team", "Crowd")
        if done.returncode != 2:
            yield f"{name}: the command line ended as {done.returncode}"
        host.get("/v1/tracks")
    except (OSError, ApiError) as error:
        yield f"{name}: an organiser is not answered: {error}"
    if os.geteuid() == 0:
        done = subprocess.run(
            [sys.executable, "-c", ASK, host.data / "myograde.sock", str(_crowds_user(host))],
            capture_output=True, text=True, timeout=120, check=False)
        if done.stdout.strip() != "200":
            yield (f"{name}: the crowd's own user is not answered: {done.stdout.strip()} "
                   f"{done.stderr[-300:]}")
    if time.monotonic() - begun > SOON_S:
        yield f"{name}: they waited for {time.monotonic() - begun:.0f} s"


def run_crowds(suite):
    mistakes = []
    with _open_to_all(suite.host):
        for name, count, text in CROWDS:
            with _crowd(suite.host, name, count, text):
                mistakes += _answers(suite.host, name, time.monotonic())
    return mistakes


def run_hoard(suite):
    """Re-runs without end: bounded, and said so."""
    host = suite.host
    folder = host.root / "hoard"
    folder.mkdir(exist_ok=True)
    mistakes = []
    (folder / "policy").write_text("#!/bin/sh\nexit 1\n")
    (folder / "policy").chmod(0o755)
    (folder / "policy.json").write_text(json.dumps({"name": "hoard", "command": ["./policy"]}))
    submission = host.submit(folder, "rt-start", "Hoard", 1)
    if host.wait(submission, 60) is None:
        mistakes.append("the submission did not end")
    refused = None
    for _ in range(400):
        try:
            host.get(f"/v1/submissions/{submission}/rerun", "POST", "{}")
        except ApiError as error:
            refused = error
            break
    if refused is None or refused.status != 409:
        mistakes.append(f"400 re-runs at once were not refused: {refused}")
    with contextlib.suppress(ApiError):
        host.get(f"/v1/submissions/{submission}/cancel", "POST", "{}")
    shutil.rmtree(folder)
    return mistakes
