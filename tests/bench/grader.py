"""A grader for the bench: temporary configs and data, a daemon, whole evaluations."""

import contextlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time

START_S = 60
EVALUATION_S = 3600


class Grader:
    """Programs of `bin_dir`, configs of `source` with the bench's tracks beside them. A context:
    what it started and wrote is gone afterwards."""

    def __init__(self, bin_dir, source):
        self.bin = pathlib.Path(bin_dir)
        self.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-bench-"))
        self.configs = self.root / "configs"
        shutil.copytree(pathlib.Path(source) / "configs", self.configs)
        for track in (pathlib.Path(source) / "tests/bench/tracks").glob("*.json"):
            shutil.copy(track, self.configs / "tracks")
        self.environment = dict(os.environ, MYOGRADE_CONFIG_DIR=str(self.configs))
        self.choose_data("data")
        self.daemon = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()
        shutil.rmtree(self.root, ignore_errors=True)

    def choose_data(self, name):
        self.data = self.root / name
        self.environment["MYOGRADE_DATA"] = str(self.data)

    def add_track(self, name, config):
        (self.configs / "tracks" / f"{name}.json").write_text(json.dumps(config))

    def start(self, **server):
        """Starts the daemon with these keys of server.json changed."""
        path = self.configs / "server.json"
        config = json.loads(path.read_text())
        config.update(uid_base=100000 + os.getpid() % 100000 * 8192, **server)
        path.write_text(json.dumps(config))
        with open(self.root / "daemon.log", "ab") as log:
            self.daemon = subprocess.Popen([self.bin / "myograde", "serve"], env=self.environment,
                                           stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        deadline = time.monotonic() + START_S
        while self.cli("status", check=False).returncode != 0:
            if self.daemon.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("the daemon did not start:\n" + self.log_tail())
            time.sleep(0.05)

    def log_tail(self):
        return (self.root / "daemon.log").read_text(errors="replace")[-2000:]

    def stop(self):
        if self.daemon is None:
            return
        self.daemon.terminate()
        try:
            self.daemon.wait(START_S)
        except subprocess.TimeoutExpired:
            self.daemon.kill()
            self.daemon.wait()
        self.daemon = None

    @contextlib.contextmanager
    def running(self, **server):
        self.start(**server)
        try:
            yield self
        finally:
            self.stop()

    def cli(self, *words, check=True):
        done = subprocess.run([self.bin / "myograde", *map(str, words)], env=self.environment,
                              stdin=subprocess.DEVNULL, capture_output=True, text=True,
                              timeout=EVALUATION_S)
        if check and done.returncode != 0:
            raise RuntimeError(f"myograde {' '.join(map(str, words))}: exit {done.returncode}\n"
                               + done.stderr[-2000:])
        return done

    def ask(self, *words):
        return json.loads(self.cli(*words, "--json").stdout)
