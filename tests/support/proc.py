"""What the kernel reports about processes."""

import os
import pathlib


def _processes():
    """Process -> (its name, its parent). The kernel keeps 15 characters of a name."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            stat = (entry / "stat").read_text(errors="replace")
        except OSError:
            continue  # it has exited
        begin, end = stat.index("("), stat.rindex(")")
        found[int(entry.name)] = stat[begin + 1:end], int(stat[end + 2:].split()[1])
    return found


def children(pid):
    """Processes whose parent is `pid`."""
    return [child for child, (_, parent) in _processes().items() if parent == pid]


def below(pid):
    """Ids and names of all descendants of `pid`."""
    processes = _processes()
    found, queue = [], [pid]
    while queue:
        above = queue.pop()
        for child, (name, parent) in processes.items():
            if parent == above:
                found.append((child, name))
                queue.append(child)
    return found


def status(pid):
    """The entries of /proc/PID/status as text. OSError if the process is gone."""
    text = pathlib.Path(f"/proc/{pid}/status").read_text(errors="replace")
    return {key: value.strip() for key, _, value in
            (line.partition(":") for line in text.splitlines())}


def memory_bytes(pid, which="VmRSS"):
    """Resident memory of a process: current, or peak (VmHWM). 0 if it has exited."""
    try:
        return 1024 * int(status(pid)[which].split()[0])
    except (OSError, KeyError):  # KeyError: a zombie
        return 0


def cpu_seconds(pid):
    """The processor time that a process has used itself. OSError if it is gone."""
    stat = pathlib.Path(f"/proc/{pid}/stat").read_text(errors="replace")
    user, system = stat[stat.rindex(")") + 2:].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
