"""A daemon with its own folders, configs, users and log."""

import itertools
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time

from . import client

HERE = pathlib.Path(__file__).resolve().parent
START_S = 60
STOP_S = 60
VERB_S = 3600  # for a verb that waits for an evaluation
LOG_TAIL = 4000
# Users of the slots: limits on processes count by user, and other daemons may be running on this
# host. Each test process has a range of PROCESS_UIDS, and each of its daemons UIDS in it for
# policies and as many for simulators, which the server places SIM_UIDS above (server/sandbox).
PROCESS_UIDS, SIM_UIDS, UIDS = 8192, 4096, 512
FIRST_UID = 100000

_numbers = itertools.count()


class DaemonError(RuntimeError):
    """The daemon did not do what it was started for, or a verb failed; includes the log's end."""


# A daemon plays the reference episodes of all environments in its first minute, some seconds of a
# processor. Most tests rank in no other than these.
REFERENCES = ("elbow", "locomotion", "manipulation")


class Daemon:
    """A daemon in a temporary folder: `root` with configs/, data/ and daemon.log.

    It uses the programs of the folder `programs` and a copy of the configs of the checkout
    `source`, which may be changed until it starts. Root may name an ordinary `user` to run it as.
    It grades ranked submissions of the environments `references`. Not started yet; close() stops it
    and removes the folder, as does the end of a `with`.
    """

    def __init__(self, programs, source, name="test", user=None, references=REFERENCES):
        self.programs = pathlib.Path(programs).absolute()
        self.user = user
        self.root = pathlib.Path(tempfile.mkdtemp(prefix=f"myograde-{name}-"))
        self.configs = self.root / "configs"
        shutil.copytree(pathlib.Path(source) / "configs", self.configs)
        for log in (self.configs / "reference").glob("*.zst"):
            if log.name.split(".")[0] not in references:
                log.unlink()
        self.uid_base = (FIRST_UID + os.getpid() % 100000 * PROCESS_UIDS
                         + next(_numbers) * UIDS % SIM_UIDS)
        self.environment = dict(os.environ, MYOGRADE_CONFIG_DIR=str(self.configs))
        self.command = [self.programs / "myograde", "serve"]
        self.data = self.root / "data"
        self.socket = None  # None: the one in the data folder
        self.process = None
        # Nobody looks at most daemons' pictures, and each takes a processor seconds.
        self.configure(uid_base=self.uid_base, pictures_ahead_s=0)
        if user is not None:
            self.data.mkdir()
            for path in (self.root, self.data):
                os.chown(path, user, user)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # --- configuration ---

    @property
    def data(self):
        """The data folder. A change takes effect at the next start."""
        return pathlib.Path(self.environment["MYOGRADE_DATA"])

    @data.setter
    def data(self, path):
        self.environment["MYOGRADE_DATA"] = str(path)

    @property
    def socket_path(self):
        return self.socket or self.data / "myograde.sock"

    def configure(self, **changes):
        """Changes keys of server.json; within an object only those that are given."""
        self.change_config("server.json", **changes)

    def change_config(self, name, **changes):
        """The same for any file of the configs."""
        path = self.configs / name
        config = json.loads(path.read_text())
        for key, value in changes.items():
            config[key] = {**config.get(key, {}), **value} if isinstance(value, dict) else value
        path.write_text(json.dumps(config))

    def add_track(self, name, config):
        (self.configs / "tracks" / f"{name}.json").write_text(json.dumps(config))

    def use_stand_in_runner(self):
        """Makes fake_runner.py play the leases, in a folder with links to all other programs."""
        folder = self.root / "bin"
        folder.mkdir()
        for program in self.programs.iterdir():
            if program.name != "myograde-runner":
                (folder / program.name).symlink_to(program)
        runner = shutil.copy(HERE / "fake_runner.py", folder / "myograde-runner")
        os.chmod(runner, 0o755)
        self.environment["MYOGRADE_BIN_DIR"] = str(folder)

    def has_user(self, uid):
        """True if `uid` belongs to one of its slots."""
        return any(0 <= uid - first < UIDS for first in (self.uid_base, self.uid_base + SIM_UIDS))

    # --- starting and stopping ---

    def _as_user(self):
        """The subprocess arguments that start a process as the daemon's user, who may not be
        allowed
        into this process's folder."""
        if self.user is None:
            return {}
        return {"user": self.user, "group": self.user, "extra_groups": [], "cwd": "/"}

    def launch(self, **environment):
        """Starts a daemon process without waiting for it; `environment` is added to its own."""
        words = [*self.command, *(["--socket", self.socket] if self.socket else [])]
        with open(self.root / "daemon.log", "ab") as log:
            return subprocess.Popen(words, env=dict(self.environment, **environment), stdout=log,
                                    stderr=log, stdin=subprocess.DEVNULL, **self._as_user())

    def start(self):
        """Launches it and waits until it answers; returns its health. DaemonError if it exits or
        takes
        too long."""
        self.process = self.launch()
        deadline = time.monotonic() + START_S
        while True:
            try:
                return client.call(self.socket_path, "GET", "/v1/health")[1]
            except OSError:
                if not self.running or time.monotonic() > deadline:
                    raise DaemonError(f"the daemon does not answer; {self.state()}") from None
                time.sleep(0.05)

    @property
    def pid(self):
        return self.process.pid

    @property
    def running(self):
        return self.process is not None and self.process.poll() is None

    def stop(self, how=signal.SIGTERM):
        """Sends the signal and waits for the exit; returns the status as subprocess does, None if
        it
        was never started. DaemonError if it has to be killed."""
        if self.process is None:
            return None
        self.process.send_signal(how)
        try:
            return self.process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise DaemonError(f"the daemon did not end in {STOP_S} s; {self.state()}") from None

    def kill(self):
        """Kills it if it is running."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def restart(self, how=signal.SIGTERM):
        self.stop(how)
        return self.start()

    def close(self):
        try:
            if self.running:
                self.stop()
        finally:
            shutil.rmtree(self.root, ignore_errors=True)

    def log(self):
        """Everything that it has logged since the first start."""
        return (self.root / "daemon.log").read_text(errors="replace")

    def state(self):
        """Whether it is still running, and the end of its log."""
        if self.process is None:
            return "it was not started"
        status = self.process.poll()
        return (f"it {'runs' if status is None else f'has ended as {status}'}; its log:\n"
                + self.log()[-LOG_TAIL:])

    # --- requests ---

    def call(self, method, path, body=None, kind=None, uid=None):
        """Status and JSON of an answer, as the user `uid` if given. An OSError includes the
        daemon's
        state."""
        try:
            if uid is not None:
                return client.call_as(uid, self.socket_path, method, path, body, kind)
            return client.call(self.socket_path, method, path, body, kind)
        except OSError as error:
            error.add_note(f"the daemon: {self.state()}")
            raise

    def ask_api(self, method, path, body=None, kind=None):
        """The JSON of an answer. ApiError if it reports an error."""
        status, answer = self.call(method, path, body, kind)
        if status >= 400:
            raise client.ApiError(status, answer)
        return answer

    def get(self, path):
        return self.ask_api("GET", path)

    def post(self, path, body=None, kind="application/json"):
        return self.ask_api("POST", path, body, kind)

    def run_verb(self, *words, timeout_s=VERB_S, **options):
        """Runs the command line tool as the daemon's user; `options` are subprocess.run's."""
        return subprocess.run([self.programs / "myograde", *map(str, words)], env=self.environment,
                              stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout_s,
                              check=False, **self._as_user(), **options)

    def cli(self, *words, check=True):
        """The same as text. If `check` is set and the exit status is not 0: DaemonError, with the
        log
        of a daemon that has exited."""
        done = self.run_verb(*words, text=True)
        if check and done.returncode != 0:
            ended = self.process is not None and not self.running
            raise DaemonError(f"myograde {' '.join(map(str, words))}: exit {done.returncode}\n"
                              f"{done.stdout[-LOG_TAIL:]}{done.stderr[-LOG_TAIL:]}"
                              + (f"the daemon: {self.state()}" if ended else ""))
        return done

    def ask(self, *words, check=True):
        """The JSON that a verb prints."""
        return json.loads(self.cli(*words, "--json", check=check).stdout)
