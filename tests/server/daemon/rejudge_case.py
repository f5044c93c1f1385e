"""What the tests of rejudges share: a track on which the stand-in's policies differ, its boards as
they are at any time, and what each of their rows should be, computed here."""

import datetime
import json
import signal
import subprocess

from phases_test import TRACK, PhasesCase
from support import client
from support.waiting import wait_until

EPISODES = 6
FULL_TIME_S = 10


def canonical(value):
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def seconds_of(seed):
    """How long the stand-in plays."""
    return 1.0 + seed % 1000 / 100


def shifted(at, milliseconds):
    """A time of an answer, so much later."""
    moment = datetime.datetime.strptime(at, "%Y-%m-%dT%H:%M:%S.%fZ")
    moment += datetime.timedelta(milliseconds=milliseconds)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}Z"


class Skill:
    """A policy of the stand-in: how many episodes it places under the usual rules and under others,
    with which force (N), and at what effort."""

    def __init__(self, placed, otherwise=None, force=10, effort=1):
        self.placed, self.force, self.effort = placed, force, effort
        self.otherwise = placed if otherwise is None else otherwise

    @property
    def mode(self):
        return f"skill-{self.placed}-{self.otherwise}-{self.force}-{self.effort}"

    def successes(self, rules=True, limit=1500):
        placed = self.placed if rules else self.otherwise
        return placed if self.force <= limit else 0

    def time(self, episodes, **how):
        done = self.successes(**how)
        played = [seconds_of(seed) if seed < done else FULL_TIME_S for seed in range(episodes)]
        return sum(played) / episodes

    def efforts(self, episodes):
        return sum(self.effort / (100 + seed) for seed in range(episodes)) / episodes


def expected_order(entries, episodes, line, factor, **how):
    """Names in board order. `entries`: (name, skill) in order of acceptance; `line`: successes of a
    hundred that put an entry above it. All by configs/README.md's rules of the board."""
    rows = [(name, skill.successes(**how), skill.time(episodes, **how), skill.efforts(episodes),
             number) for number, (name, skill) in enumerate(entries)]
    is_above = lambda row: row[1] * 100 >= line * episodes
    above = sorted(filter(is_above, rows), key=lambda row: (row[2], row[4]))
    order, opener, band = [], None, []
    for row in above:
        if opener is None or row[2] > opener * factor:
            order += sorted(band, key=lambda one: (one[3], one[4]))
            opener, band = row[2], []
        band.append(row)
    order += sorted(band, key=lambda one: (one[3], one[4]))
    below = [row for row in rows if not is_above(row)]
    order += sorted(below, key=lambda row: (-row[1], row[2], row[3], row[4]))
    return [row[0] for row in order]


class RejudgeCase(PhasesCase):
    """Most tests are about the board of TRACK itself."""

    board_path = f"/v1/leaderboard?track={TRACK}"

    def start(self):
        if not (self.folder / "cache").exists():
            self.use_build("one")
        super().start()

    def use_build(self, name):
        """Gives the daemon a simulator and a library with bytes of their own, which nothing runs."""
        library = self.folder / "cache/mujoco-2.2.2/lib/libmujoco.so.2.2.2"
        library.parent.mkdir(parents=True, exist_ok=True)
        library.write_text(f"library {name}")
        simulator = self.folder / "bin/myograde-sim"
        simulator.unlink(missing_ok=True)
        simulator.write_text(f"simulator {name}")

    def text(self, path):
        """The bytes of an answer."""
        connection = client.Connection(self.daemon.socket_path)
        try:
            status, body = client.exchange(connection, "GET", path)
        finally:
            connection.close()
        self.assertEqual(status, 200, body)
        return body

    def order(self, path=None):
        return [row["team"] for row in self.get(path or self.board_path)["rows"]]

    def file(self, config, name="rules.json"):
        path = self.folder / name
        path.write_text(config if isinstance(config, str) else json.dumps(config))
        return path

    def scoring(self, **scoring):
        return self.file({"extends": TRACK, "scoring": scoring})

    def create(self, config=None, *more, board=("--track", TRACK), wait=True):
        words = [*board, *(("--config", config) if config else ()), *more]
        return self.ask("board", "rejudge", "create", *words, "--reason", "new rules",
                        *(("--wait",) if wait else ()), schema="rejudge")

    def act(self, verb, rejudge, *more):
        return self.ask("board", "rejudge", verb, rejudge, "--reason", f"{verb} it", *more,
                        schema="rejudge")

    def show(self, rejudge):
        return self.ask("board", "rejudge", "show", rejudge, schema="rejudge")

    def fails(self, *words, status=2):
        """The sentence of a verb that is refused."""
        done = self.cli("board", "rejudge", *words, check=False)
        self.assertEqual(done.returncode, status, f"{words}\n{done.stdout}{done.stderr}")
        lines = done.stderr.strip().splitlines()
        self.assertEqual(len(lines), 1, done.stderr)
        self.assertTrue(lines[0].startswith("myograde: error: "), lines)
        return lines[0]

    def computed(self, rejudge):
        return wait_until(lambda: self.get(f"/v1/rejudges/{rejudge}"), 300, "it is not computed",
                          lambda one: one["state"] != "computing", every_s=0.5)

    def ranks(self, rejudge, board="main"):
        """By team: the ranks before and after that show tells of."""
        boards = {one["board"]: one for one in self.show(rejudge)["boards"]}
        rank = lambda side: None if side is None else side["rank"]
        return {row["team"]: (rank(row["before"]), rank(row["after"]))
                for row in boards[board]["rows"]}

    def is_signed(self, document, signature):
        """Whether the published key has signed a document, which OpenSSL's own program tells."""
        for name, content in (("key.pem", self.get("/v1/key")["key"].encode()),
                              ("document", canonical(document)),
                              ("signature", bytes.fromhex(signature))):
            (self.folder / name).write_bytes(content)
        done = subprocess.run(
            ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", "key.pem", "-rawin", "-in",
             "document", "-sigfile", "signature"],
            cwd=self.folder, capture_output=True, timeout=60, check=False)
        return done.returncode == 0

    def check_signatures(self, rejudge):
        """Every event's document is signed, and says what was done. The events' names."""
        for event in rejudge["events"]:
            document = event["document"]
            self.assertTrue(self.is_signed(document, event["signature"]))
            self.assertFalse(self.is_signed({**document, "reason": "x"}, event["signature"]))
            for name in ("event", "at", "who", "reason"):
                self.assertEqual(document[name], event[name])
            for name in ("rejudge", "phase", "track", "from_config", "to_config", "repeats"):
                self.assertEqual(document[name], rejudge[name])
        return [event["event"] for event in rejudge["events"]]

    def restart(self, how=signal.SIGTERM):
        self.stop(how)
        self.start()
