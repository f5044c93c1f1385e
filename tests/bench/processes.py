"""What the bench asks the kernel about processes."""

import json
import pathlib
import threading
import time

from support import proc

PERIOD_S = 0.2


def last_json(text):
    """The last line of a text that is a JSON object."""
    for line in reversed(text.splitlines()):
        if line.startswith("{"):
            return json.loads(line)
    raise RuntimeError(f"the policy said nothing: {text!r}")


def drop_file_caches():
    """True if the kernel let go of the files that it holds in memory (needs root)."""
    try:
        pathlib.Path("/proc/sys/vm/drop_caches").write_text("1\n")
        return True
    except OSError:
        return False


def proportional_bytes(pid):
    """Memory of a process, what it shares counted in shares (PSS); 0 if it is gone."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0


def cpu_seconds(pid):
    """Processor time of a process, its ended threads included, its children not."""
    # The kernel's number of a process's clock: see clock_getcpuclockid(3). To the nanosecond, where
    # /proc/PID/stat counts in hundredths of a second.
    return time.clock_gettime(~pid << 3 | 2)


class MemoryWatch:
    """The largest memory of the processes of a name below another, looked at now and then."""

    def __init__(self, name):
        self.name = name[:15]  # as the kernel keeps it
        self.largest = 0
        self._stopped = threading.Event()
        self._thread = None

    def start(self, root):
        self._stopped.clear()
        self._thread = threading.Thread(target=self._watch, args=(root,), daemon=True)
        self._thread.start()

    def stop(self):
        self._stopped.set()
        self._thread.join()

    def _watch(self, root):
        while not self._stopped.is_set():
            for pid, name in proc.below(root):
                if name == self.name:
                    self.largest = max(self.largest, proportional_bytes(pid))
            time.sleep(PERIOD_S)
