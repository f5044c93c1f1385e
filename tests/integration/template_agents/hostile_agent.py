"""Agents that no template made. The first argument says which."""

import os
import pickle
import socket
import subprocess
import sys
import time

import evaluation_pb2
import numpy as np
from utils import RemoteConnection


class Runs:
    """Unpickled, it runs a command in the process that reads it."""

    def __init__(self, command):
        self.command = command

    def __reduce__(self):
        return os.system, (self.command,)


def pickles():
    """What the reader runs, runs in this sandbox: it sees this agent's files and can end its own
    service, no more."""
    rc = RemoteConnection("localhost:8085")
    rc.reset()
    marker = "/tmp/was-run"
    try:
        rc.act_on_environment(Runs(f"id -u > {marker}; ls /policy >> {marker}"))
    except Exception as error:
        print(type(error).__name__, file=sys.stderr)
    with open(marker, encoding="utf-8") as text:
        ran = text.read().split()
    assert ran[0] == str(os.getuid()) and "policy.json" in ran, ran
    for rubbish in (b"", b"\x80\x04.", b"cposix\n_exit\n(I0\ntR"[:-1], b"\xff" * 100):
        try:
            rc.stub.act_on_environment(evaluation_pb2.Package(SerializedEntity=rubbish))
        except Exception as error:
            print(str(error.details())[:60], file=sys.stderr)
    for action in (np.zeros(3), "up", None, [[]], {"a": 1}, np.zeros((80, 80))):
        try:
            rc.act_on_environment(action)
            raise AssertionError(f"{action!r} is an action")
        except AssertionError:
            raise
        except Exception as error:
            print(str(error.details())[:60], file=sys.stderr)
    rc.act_on_environment(np.zeros(80))
    print("still served", file=sys.stderr, flush=True)
    rc.act_on_environment(Runs("kill -9 $PPID"))


def flood():
    """More connections than the sandbox may have."""
    sockets = []
    while True:
        sockets.append(socket.create_connection(("localhost", 8085), timeout=5))
        sockets[-1].send(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + os.urandom(64))


def silent():
    """Never connects."""
    time.sleep(0.9)
    while True:
        subprocess.run(["/bin/sleep", "5"], check=False)


def leaves():
    rc = RemoteConnection("localhost:8085")
    rc.reset()
    rc.act_on_environment(np.zeros(80))
    print("I have seen enough", file=sys.stderr, flush=True)
    sys.exit(7)


def large():
    """A message larger than gRPC takes, and a small one that grows."""
    rc = RemoteConnection("localhost:8085")
    rc.reset()
    try:
        rc.act_on_environment(np.zeros(1_000_000))
    except Exception as error:
        print(error.code(), file=sys.stderr, flush=True)
    package = evaluation_pb2.Package(SerializedEntity=pickle.dumps(Grows()))
    rc.stub.act_on_environment(package)


class Grows:
    def __reduce__(self):
        return bytearray, (64 << 30,)


{"pickles": pickles, "flood": flood, "silent": silent, "leaves": leaves, "large": large}[
    sys.argv[1]]()
