"""Looks for the host in /proc and /sys."""
import os
import re

import hostile


def read(path, size=65536):
    with open(path, "rb") as file:
        return file.read(size)


def look(_player):
    for name in ("environ", "maps", "mem", "auxv", "stack", "syscall", "smaps", "io"):
        hostile.attempt(f"first_{name}", lambda name=name: read(f"/proc/1/{name}", 16))
    for name in ("root", "cwd", "exe"):
        hostile.attempt(f"first_{name}", lambda name=name: os.readlink(f"/proc/1/{name}"))
    hostile.attempt("first_fd", lambda: os.listdir("/proc/1/fd"))
    for path in ("/proc/kcore", "/proc/kmsg", "/proc/sysrq-trigger", "/sys/kernel", "/sys/class",
                 "/sys/fs/cgroup", "/dev/mem", "/dev/kmsg", "/dev/sda", "/dev/vda", "/run/dbus",
                 "/proc/1/root/etc/shadow", "/etc/shadow", "/etc/hostname", "/etc/machine-id",
                 "/root", "/home", "/var/lib", "/var/log", "/boot", "/opt", "/srv", "/mnt"):
        look_at = os.listdir if os.path.isdir(path) else read
        hostile.attempt(path.strip("/").replace("/", "_"), lambda: look_at(path))
    hostile.attempt("write_sysctl",
                    lambda: os.open("/proc/sys/kernel/hostname", os.O_WRONLY))
    hostile.attempt("write_core_pattern",
                    lambda: os.open("/proc/sys/kernel/core_pattern", os.O_WRONLY))
    # Process 1 is the bridge; all others must be our own.
    own = {pid for pid in os.listdir("/proc") if pid.isdigit()} - {"1"}
    strange = [pid for pid in own if os.stat(f"/proc/{pid}").st_uid != os.getuid()]
    hostile.report("processes", len(own))
    hostile.report("strange_processes", len(strange))
    hostile.report("hostname", os.uname().nodename)
    groups = read("/proc/self/cgroup").decode()
    hostile.report("cgroup_above", len(re.findall(r":/.*[^/\n]", groups)))
    devices = len(read("/proc/net/dev").splitlines()) - 2
    hostile.report("network_devices", devices)


hostile.play(look)
