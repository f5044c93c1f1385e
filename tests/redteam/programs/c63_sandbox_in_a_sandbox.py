"""Starts the host's own namespace tools, to try to create its own sandbox."""
import errno
import subprocess

import hostile

COMMANDS = {
    "bwrap": ["bwrap", "--bind", "/", "/", "--unshare-user", "true"],
    "bwrap_plain": ["bwrap", "--ro-bind", "/", "/", "true"],
    "unshare": ["unshare", "--user", "--map-root-user", "true"],
    "unshare_net": ["unshare", "--net", "true"],
    "nsenter": ["nsenter", "--target", "1", "--all", "true"],
    "chroot": ["chroot", "/tmp", "true"],
    "mount": ["mount", "-t", "tmpfs", "none", "/tmp"],
    "setpriv": ["setpriv", "--reuid", "0", "true"],
    "newuidmap": ["newuidmap", "1", "0", "0", "1"],
}


def run(command):
    done = subprocess.run(command, capture_output=True, timeout=20, check=False)
    if done.returncode != 0:
        raise PermissionError(errno.EPERM, "refused")


def attack(_player):
    for name, command in COMMANDS.items():
        hostile.attempt(name, lambda command=command: run(command))


hostile.play(attack)
