"""Lists what it can read below /proc, /sys and /dev beside its own processes, and looks whether any
of it changes while others work."""
import ctypes
import os
import time

import hostile


def content(path):
    try:
        with open(path, "rb") as file:
            return file.read(1 << 20)
    except OSError:
        return b""


def files(folder):
    """All that is not a link and has content, by its path below `folder`."""
    found = {}
    for above, folders, names in os.walk(folder):
        if above == "/proc":
            folders[:] = [name for name in folders if not name.isdigit()]
        for name in names:
            path = os.path.join(above, name)
            if not os.path.islink(path) and (text := content(path)):
                found[os.path.relpath(path, folder)] = text
    return found


def devices():
    for above, _, names in os.walk("/dev"):
        for name in names:
            path = os.path.join(above, name)
            if not os.path.islink(path) and "/shm" not in above:
                yield os.path.relpath(path, "/dev")


def tell(name, words):
    hostile.report(name, ",".join(sorted(words)) or "nothing")


def look(_player):
    before = files("/proc")
    network = files("/proc/self/net")
    system = files("/sys")
    tell("proc", [name for name in before if not name.startswith("sys/")])
    tell("settings", [name[4:] for name in before if name.startswith("sys/")])
    tell("network", network)
    tell("system", system)
    tell("devices", devices())
    # Faults, forks, a lock, memory: what counters of the host count.
    for _ in range(20):
        bytearray(1 << 20)
        os.waitpid(hostile.spawn(lambda: None), 0)
        time.sleep(0.02)
    after = files("/proc")
    tell("changing", [name for name in before
                      if before[name] != after.get(name) and name != "sys/kernel/random/uuid"])
    strange = [pid for pid in os.listdir("/proc")
               if pid.isdigit() and os.stat(f"/proc/{pid}").st_uid not in (os.getuid(), 65534)]
    tell("strange", strange)
    # What libraries ask for is there.
    hostile.report("processors", "some" if os.cpu_count() > 0 else "none")
    features = b"model name" in before.get("cpuinfo", b"") or os.uname().machine != "x86_64"
    hostile.report("features", "named" if features else "missing")
    pages = ctypes.CDLL(None).get_phys_pages()
    hostile.report("memory", "told" if pages > 0 else "unknown")


hostile.play(look)
