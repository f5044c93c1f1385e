"""Runs the programs that handle what comes from elsewhere: pip, apt-get, dpkg-deb. If root asks,
they run as the user nobody without any privilege; and they have a deadline and a limit of disk."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import time
from typing import Sequence

import tree
from failure import Trouble, WrongUse

NOBODY = 65534
# Seconds between lines of progress where there is no terminal.
TELL_EVERY = 30.0
PASSED_ON = ("http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY",
             "SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE")


def _has_nobody() -> bool:
    """Whether this process may become the user nobody: not in a user namespace without them."""
    if os.geteuid() != 0:
        return False
    for line in pathlib.Path("/proc/self/uid_map").read_text(encoding="ascii").splitlines():
        first, _, count = map(int, line.split())
        if first <= NOBODY < first + count:
            return True
    return False


class Worker:
    """Its folder is the only one that its programs can write to, apart from /tmp."""

    def __init__(self, folder: pathlib.Path, deadline_s: float, most_bytes: int) -> None:
        self.folder = folder
        self._end = time.monotonic() + deadline_s
        self._most_bytes = most_bytes
        self._lowered = _has_nobody()
        folder.mkdir()
        if self._lowered:
            os.chown(folder, NOBODY, NOBODY)
        self._settings = self._settings_of_pip()

    def _settings_of_pip(self) -> dict[str, str]:
        """The caller's settings of pip (its index, say), which the programs can't find themselves, as
        they have another home."""
        if "PIP_CONFIG_FILE" in os.environ:
            return {}
        home = pathlib.Path.home()
        for path in (home / ".config/pip/pip.conf", home / ".pip/pip.conf"):
            if path.is_file():
                own = self.folder / "pip.conf"
                own.touch(0o600)
                own.write_bytes(path.read_bytes())
                self.give(own)
                return {"PIP_CONFIG_FILE": str(own)}
        return {}

    def give(self, path: pathlib.Path) -> None:
        """Lets the programs change what was put into the folder."""
        if self._lowered:
            os.chown(path, NOBODY, NOBODY, follow_symlinks=False)

    def run(self, words: Sequence[str], says: str, **environment: str) -> str:
        """Runs a program in the folder and returns what it printed. `says` is what it does, for the
        progress. Trouble: it failed (with its last words) or took too long; WrongUse: it wrote too
        much."""
        command = list(words)
        if self._lowered:
            command = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups",
                       "--no-new-privs", "--bounding-set=-all", "--inh-caps=-all",
                       "--pdeathsig=KILL", "--", *command]
        else:
            command = ["setpriv", "--no-new-privs", "--pdeathsig=KILL", "--", *command]
        passed = {name: value for name, value in os.environ.items()
                  if name in PASSED_ON or name.startswith("PIP_")}
        log = self.folder.parent / "log"
        with open(log, "w+b") as output, subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, start_new_session=True,
                env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8",
                     "HOME": str(self.folder), "TMPDIR": str(self.folder), **passed,
                     **self._settings, **environment}) as child:
            try:
                self._watch(child, says)
            finally:
                try:
                    os.killpg(child.pid, 9)
                except ProcessLookupError:
                    pass
            output.seek(0)
            text = output.read().decode(errors="replace")
        if child.returncode != 0:
            raise Trouble(f"{says}: {pathlib.Path(words[0]).name} failed: {last_words(text)}")
        return text

    def _watch(self, child: subprocess.Popen, says: str) -> None:
        shown = sys.stderr.isatty()
        told = time.monotonic()
        while True:
            try:
                child.wait(timeout=0.5)
                break
            except subprocess.TimeoutExpired:
                pass
            size = tree.bytes_below(self.folder)
            if shown:
                print(f"\r\x1b[K{says}: {size / 1e6:.0f} MB", end="", file=sys.stderr, flush=True)
            elif time.monotonic() - told >= TELL_EVERY:
                told = time.monotonic()
                print(f"{says}: {size / 1e6:.0f} MB so far", file=sys.stderr, flush=True)
            # What is downloaded and what is unpacked of it lie here at the same time.
            if size > 2 * self._most_bytes:
                raise WrongUse(f"{says}: more than {2 * self._most_bytes} bytes were written; raise "
                               "--most-bytes if the runtime is to be that large")
            if time.monotonic() > self._end:
                raise Trouble(f"{says}: not done in time; see whether the network works, or raise "
                              "--timeout")
        if shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def last_words(text: str) -> str:
    """The end of a program's output, on one line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith(("ERROR", "E:", "error"))] or lines
    return " / ".join(errors[-3:])[-600:] or "it printed nothing"
