"""Cases 85 and 86: clients of the API that break no rule and want to freeze it or fill its queue. An
organiser and an honest submission are served all the same."""

import contextlib
import json
import shutil
import socket
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


@contextlib.contextmanager
def _crowd(path, count, text):
    clients = []
    for _ in range(count):
        client = socket.socket(socket.AF_UNIX)
        client.settimeout(SOON_S)
        clients.append(client)
        with contextlib.suppress(OSError):  # it was asked to go
            client.connect(path)
            client.sendall(text)
    try:
        yield clients
    finally:
        for client in clients:
            client.close()


def _asked_until(over, ask):
    """The answer, asked again where 429 says to: a crowd of one's own uid takes one's own places."""
    while True:
        try:
            return ask()
        except ApiError as error:
            if error.status != 429 or time.monotonic() > over:
                raise
            time.sleep(1)


def run_crowds(suite):
    host = suite.host
    mistakes = []
    for name, count, text in CROWDS:
        with _crowd(str(host.data / "myograde.sock"), count, text) as clients:
            begun = time.monotonic()
            try:
                health = _asked_until(begun + SOON_S, lambda: host.get("/v1/health"))
                if health["status"] != "ok":
                    mistakes.append(f"{name}: the daemon is not well")
                done = host.cli("submit", host.root / "absent", "--track", "rt", "--team", "Crowd")
                if done.returncode != 2:
                    mistakes.append(f"{name}: the command line ended as {done.returncode}")
            except (OSError, ApiError) as error:
                mistakes.append(f"{name}: an organiser is not answered: {error}")
            if name == "slow uploads":
                for client in clients:
                    with contextlib.suppress(OSError):
                        client.send(b"x" * 3000)
                    time.sleep(0.02)
                host.get("/v1/tracks")
            if time.monotonic() - begun > SOON_S:
                mistakes.append(f"{name}: an organiser waited for {time.monotonic() - begun:.0f} s")
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
