"""Cases 85 and 86: API clients that break no rule and try to freeze it or fill its queue.
An organiser and an honest submission are served all the same, and so is the user that the crowd
belongs to. If root runs the daemon, the crowd is another user's, as limits are per user, and that
user makes requests too; else the crowd, the organiser and the honest one are all the same ordinary
user."""

import contextlib
import json
import os
import shutil
import time

from support.client import ApiError
from support.crowd import UPLOAD, crowd

SOON_S = 30
# Name, how many, and what each sends before it falls silent.
CROWDS = (
    ("silent uploads", 70, UPLOAD % 1000),
    ("slow uploads", 80, UPLOAD % (1 << 20)),
    ("announced gigabytes", 80, UPLOAD % (4 << 30)),
    ("idle connections", 300, b""),
    ("half heads", 300, b"GET /v1/hea"),
    ("half chunks", 300, b"POST /v1/submissions HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nf"),
    ("answers that nobody reads", 300, b"GET /v1/tracks HTTP/1.1\r\nHost: localhost\r\n\r\n" * 200),
    ("broken heads", 300, b"GET / HTTP/1.1\n\n\0\xff" * 50),
)

STRANGER = 61990


def _crowds_user(host):
    """For an ordinary user's daemon the same user, as nobody else may connect to it."""
    return STRANGER if host.user is None else host.user


@contextlib.contextmanager
def _open_to_all(host):
    """Opens the socket and the path to it while the crowds are there."""
    if os.geteuid() != 0 or host.user is not None:
        yield
        return
    modes = [(path, path.stat().st_mode & 0o7777)
             for path in (host.root, host.data, host.socket_path)]
    for (path, _), mode in zip(modes, (0o711, 0o711, 0o666)):
        path.chmod(mode)
    try:
        yield
    finally:
        for path, mode in modes:
            path.chmod(mode)


def _answers(host, name, begun):
    """Problems of an organiser and of the crowd's own user while the crowd is there."""
    try:
        if host.get("/v1/health")["status"] != "ok":
            yield f"{name}: the daemon is not well"
        done = host.verb("submit", host.root / "absent", "--track", "rt", "--team", "Crowd")
        if done.returncode != 2:
            yield f"{name}: the command line ended as {done.returncode}"
        host.get("/v1/tracks")
    except (OSError, ApiError) as error:
        yield f"{name}: an organiser is not answered: {error}"
    if os.geteuid() == 0:
        try:
            status, answer = host.call("GET", "/v1/health", uid=_crowds_user(host))
        except OSError as error:
            status, answer = None, error
        if status != 200:
            yield f"{name}: the crowd's own user is not answered: {status} {answer}"
    if time.monotonic() - begun > SOON_S:
        yield f"{name}: they waited for {time.monotonic() - begun:.0f} s"


def run_crowds(suite):
    mistakes = []
    with _open_to_all(suite.host):
        for name, count, text in CROWDS:
            with crowd(suite.host.socket_path, count, text,
                       uid=_crowds_user(suite.host) if os.geteuid() == 0 else None,
                       slow=name == "slow uploads"):
                mistakes += _answers(suite.host, name, time.monotonic())
    return mistakes


def run_hoard(suite):
    """Endless reruns: bounded, and the answer says so."""
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
    for _ in range(2000):  # some end while others are asked for
        try:
            host.post(f"/v1/submissions/{submission}/rerun", {})
        except ApiError as error:
            refused = error
            break
    if refused is None or refused.status != 409:
        mistakes.append(f"2,000 reruns at once were not refused: {refused}")
    with contextlib.suppress(ApiError):
        host.post(f"/v1/submissions/{submission}/cancel", {})
    shutil.rmtree(folder)
    return mistakes
