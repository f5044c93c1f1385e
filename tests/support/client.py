"""HTTP over the Unix socket of a daemon.

As a program: client.py SOCKET UID METHOD PATH [TYPE] makes one request as that user (-1: the
caller) with the body from standard input, and prints the status and the JSON as a list."""

import http.client
import json
import os
import socket
import subprocess
import sys

TIMEOUT_S = 60  # other clients may be served first


class ApiError(Exception):
    """A daemon's answer that reports an error. `answer` is its JSON."""

    def __init__(self, status, answer):
        super().__init__(f"HTTP {status}: {answer}")
        self.status = status
        self.answer = answer


class Connection(http.client.HTTPConnection):
    """A connection to the socket at `path`, opened by the first request; each wait times out after
    `timeout_s`."""

    def __init__(self, path, timeout_s=TIMEOUT_S):
        super().__init__("myograde", timeout=timeout_s)
        self.path = str(path)

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


def exchange(connection, method, path, body=None, kind=None):
    """Status and bytes of the answer to one request. A dict or list as `body` is sent as JSON;
    `kind` is the body's type."""
    if isinstance(body, (dict, list)):
        body = json.dumps(body)
    connection.request(method, path, body, {"Content-Type": kind} if kind else {})
    answer = connection.getresponse()
    return answer.status, answer.read()


def call(socket_path, method, path, body=None, kind=None, timeout_s=TIMEOUT_S):
    """Status and JSON of the answer to one request on a separate connection. OSError or
    http.client.HTTPException if there is no answer."""
    connection = Connection(socket_path, timeout_s)
    try:
        status, text = exchange(connection, method, path, body, kind)
        return status, json.loads(text)
    finally:
        connection.close()


def command(socket_path, uid, method, path, kind=None):
    """The command line that runs this module as a program; without `uid` as the caller."""
    return [sys.executable, "-B", os.path.abspath(__file__), str(socket_path),
            str(-1 if uid is None else uid), method, path, *([kind] if kind else [])]


def call_as(uid, socket_path, method, path, body=None, kind=None):
    """call() as another user, which only root can do. OSError if there is no answer."""
    if isinstance(body, (dict, list)):
        body = json.dumps(body)
    done = subprocess.run(command(socket_path, uid, method, path, kind),
                          input=body.encode() if isinstance(body, str) else body or b"",
                          capture_output=True, timeout=2 * TIMEOUT_S, check=False)
    if done.returncode != 0:
        raise OSError(f"user {uid} got no answer: {done.stderr.decode()[-300:]}")
    return tuple(json.loads(done.stdout))


def main():
    socket_path, uid, method, path, *kind = sys.argv[1:]
    if int(uid) >= 0:
        os.setgid(int(uid))
        os.setuid(int(uid))
    body = sys.stdin.buffer.read() or None
    print(json.dumps(call(socket_path, method, path, body, *kind)))


if __name__ == "__main__":
    main()
