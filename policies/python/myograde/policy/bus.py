"""The bus of a sandbox, and the end of a policy: once the last episode is over the grader sends
SIGTERM, and a policy that ends by it flushes its files and runs what atexit was given."""

from __future__ import annotations

import os
import select
import signal
import sys


class Bus:
    """LCM at the address in MYOGRADE_LCM_URL. Exits with 1 and a sentence if there is none."""

    def __init__(self) -> None:
        try:
            import lcm  # here, so that the rest of the package needs nothing
        except ImportError as error:
            sys.exit(f"error: the package lcm is missing ({error}); name the runtime \"python\" in policy.json, or "
                     "add lcm to the submission")
        url = os.environ.get("MYOGRADE_LCM_URL", "")
        try:
            self._lcm = lcm.LCM(url)
        except RuntimeError as error:
            sys.exit(f'error: no LCM bus at "{url}" ({error}); set MYOGRADE_LCM_URL')
        self.subscribe = self._lcm.subscribe
        self.publish = self._lcm.publish
        self._waiting = False
        self._asked_to_end = False
        try:
            if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
                signal.signal(signal.SIGTERM, self._on_term)
        except ValueError:
            pass  # not the main thread: SIGTERM ends the process as ever

    def wait(self, seconds: float) -> None:
        """Handles one message, or none if none comes in time."""
        if self._asked_to_end:
            sys.exit(0)
        self._waiting = True
        try:
            # Not in LCM, whose wait takes a signal for an error.
            readable, _, _ = select.select([self._lcm.fileno()], [], [], seconds)
        finally:
            self._waiting = False
        if readable:
            self._lcm.handle()

    def _on_term(self, _signal, _frame):
        self._asked_to_end = True
        if self._waiting:
            sys.exit(0)
