"""A grader for the bench: the bench's tracks, and whole evaluations by a daemon."""

import contextlib
import pathlib
import shutil

from support.daemon import Daemon


class Grader(Daemon):
    """Programs of `bin_dir`, configs of `source` with the bench's tracks beside them."""

    def __init__(self, bin_dir, source):
        super().__init__(bin_dir, source, "bench")
        for track in (pathlib.Path(source) / "tests/bench/tracks").glob("*.json"):
            shutil.copy(track, self.configs / "tracks")

    def choose_data(self, name):
        """Another data folder from the next start on."""
        self.data = self.root / name

    @contextlib.contextmanager
    def running_with(self, **server):
        """Runs the daemon with these keys of server.json changed."""
        self.configure(**server)
        self.start()
        try:
            yield self
        finally:
            self.stop()
