"""The participant's program, as a child of the adapter."""

import os
import signal
import sys
import time

HOOKS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "hooks")
# What concerns the adapter alone.
_NOT_PASSED_ON = ("MYOGRADE_LCM_URL", "PYTHONHOME", "LC_CTYPE")


def agent_environment(settings, runtimes, own=os.environ):
    """The agent's variables: those of this process, then `settings` (NAME=VALUE). Its Python finds
    the hooks first, then what the settings name, then the runtimes."""
    environment = {name: value for name, value in own.items() if name not in _NOT_PASSED_ON}
    environment.pop("PYTHONPATH", None)
    environment.update(setting.split("=", 1) for setting in settings)
    path = [HOOKS, *filter(None, [environment.get("PYTHONPATH")]), *runtimes]
    environment["PYTHONPATH"] = ":".join(path)
    return environment


class Agent:
    """Forked at once, while this process has one thread, and executed by start()."""

    def __init__(self, command, environment, folder):
        waits, self._gate = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._gate)
            self._become(waits, command, environment, folder)
        os.close(waits)

    def start(self):
        os.write(self._gate, b"1")
        os.close(self._gate)

    def wait(self):
        """Its exit status; -N if signal N ended it."""
        _, status = os.waitpid(self._pid, 0)
        return os.waitstatus_to_exitcode(status)

    def end(self, seconds):
        """Lets it end by itself for a while, then asks it to."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            ended, _ = os.waitpid(self._pid, os.WNOHANG)
            if ended:
                return
            time.sleep(0.01)
        try:
            os.killpg(self._pid, signal.SIGTERM)
        except ProcessLookupError:
            pass

    @staticmethod
    def _become(gate, command, environment, folder):
        # Its own session: what the grader sends to the adapter's is for the adapter, which first
        # tells the agent that the evaluation is over.
        os.setsid()
        try:
            if not os.read(gate, 1):
                os._exit(1)  # the adapter ended before it listened
            os.chdir(folder)
            os.execvpe(command[0], command, environment)
        except OSError as error:
            print(f"template: the agent {command[0]} can't be started: {error.strerror}",
                  file=sys.stderr, flush=True)
        os._exit(127)
