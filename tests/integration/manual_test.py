"""Holds the challenge of the organisers' manual: every command of it, in its order, on the server
and on three participants' machines, over TLS on loopback. Between the steps it tries what must not
work."""

import json
import os
import pathlib
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import time

from system import BIN, POLICIES, SOURCE, SystemTest

MANUAL = SOURCE / "configs/challenges/MANUAL.md"
HEADING = re.compile(r"^(##|###) ([^\n]*)$|^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SERVER, PARTICIPANT = "On the server", "On a participant's machine"
WALKERS = {"alpha": "scripted-locomotion", "beta": "random", "gamma": "zero"}
PAST, FUTURE = "2020-01-01T00:00:00Z", "2099-01-01T00:00:00Z"
EXPORT = re.compile(r"^export .*$", re.MULTILINE)
START_S = 60


def steps():
    """The commands of a section by its number: a list of (who types them, text)."""
    found, section, who = {}, 0, None
    for match in HEADING.finditer(MANUAL.read_text(encoding="utf-8")):
        level, title, body = match.groups()
        if level == "##":
            number = re.match(r"(\d+)\. ", title)
            section = int(number[1]) if number else 0
        elif level == "###":
            who = title
        else:
            found.setdefault(section, []).append((who, body))
    return found


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Manual(SystemTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.work = cls.root / "work"
        cls.work.mkdir()
        shutil.copytree(cls.daemon.configs, cls.work / "configs")
        # As in a checkout after ./dev build.
        (cls.work / "build/release").mkdir(parents=True)
        (cls.work / "build/release/policies").symlink_to(POLICIES)
        cls.port = str(free_port())
        cls.steps = steps()
        cls.exports = ""
        cls.server_environment = {
            key: value for key, value in cls.environment.items()
            if key not in ("MYOGRADE_CONFIG_DIR", "MYOGRADE_DATA")}
        cls.server_environment["PATH"] = f"{BIN}:{os.environ['PATH']}"
        cls.addClassCleanup(cls.stop_server)
        for team, walker in WALKERS.items():
            home = cls.home(team)
            for name, policy in (("elbow", "scripted-elbow"), ("walker", walker)):
                shutil.copytree(POLICIES / policy, home / f"policies/{team}-{name}")

    # --- who types ---

    @classmethod
    def home(cls, team):
        return cls.root / team

    @classmethod
    def bash(cls, text, folder, environment):
        text = text.replace("8443", cls.port)
        return subprocess.run(["bash", "-e", "-c", text], cwd=folder, env=environment, text=True,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, timeout=600, check=False)

    @classmethod
    def on_server(cls, text):
        done = cls.bash(cls.exports + text, cls.work, cls.server_environment)
        cls.exports += "".join(line + "\n" for line in EXPORT.findall(text))
        return done

    def on_laptop(self, team, text, **variables):
        environment = {key: value for key, value in self.server_environment.items()
                       if not key.startswith("MYOGRADE_") or key == "MYOGRADE_CACHE"}
        environment.update(HOME=str(self.home(team)), XDG_CONFIG_HOME=str(self.home(team) / "config"),
                           **variables)
        return self.bash(re.sub(r"\balpha\b", team, text), self.home(team), environment)

    def works(self, done):
        self.assertEqual(done.returncode, 0, f"{done.args[-1]}\n{done.stdout}\n{done.stderr}\n"
                         f"{self.log()}")
        return done.stdout

    def refused(self, done, *words):
        """Fails as a use that is not allowed, with one sentence."""
        self.assertEqual(done.returncode, 2, f"{done.args[-1]}\n{done.stdout}\n{done.stderr}")
        for word in words:
            self.assertIn(word, done.stderr)
        return done.stderr

    def follow(self, section, who, number=0, team=None, **variables):
        """Types one of a section's blocks, which must work."""
        text = [body for typist, body in self.steps[section] if typist == who][number]
        if team is None:
            return self.works(self.on_server(text))
        return self.works(self.on_laptop(team, text, **variables))

    def ask_server(self, words):
        return json.loads(self.works(self.on_server(f"myograde {words} --json")))

    def ask_laptop(self, team, words):
        return json.loads(self.works(self.on_laptop(team, f"myograde {words} --json")))

    def log(self):
        path = self.work / "cup.log"
        return path.read_text(errors="replace")[-4000:] if path.exists() else ""

    # --- the server's process and calendar ---

    @classmethod
    def stop_server(cls):
        health = cls.on_server("myograde status --json")
        if health.returncode != 0:
            return
        pid = json.loads(health.stdout)["daemon"]["pid"]
        os.kill(pid, signal.SIGTERM)
        deadline = time.monotonic() + START_S
        while pathlib.Path(f"/proc/{pid}/cmdline").exists() and time.monotonic() < deadline:
            if not pathlib.Path(f"/proc/{pid}/cmdline").read_bytes():
                return  # nobody waits for it
            time.sleep(0.05)

    def start_server(self):
        self.follow(4, SERVER)  # waits until it is ready

    def schedule(self, **times):
        """Moves the final's times and restarts the daemon, as the manual says."""
        file = self.work / "cup/challenges/winter-cup.json"
        challenge = json.loads(file.read_text())
        challenge["phases"][0].update(opens_at=PAST, closes_at=FUTURE)
        challenge["phases"][1].update(times)
        file.write_text(json.dumps(challenge))
        self.stop_server()
        self.start_server()

    def phase(self, asked, name="final"):
        return next(phase for challenge in asked["challenges"] for phase in challenge["phases"]
                    if phase["phase"] == name)

    def teams_on(self, board):
        return sorted(row["team"] for row in board["rows"])

    def seeds(self):
        """Those of the final, as the store has them."""
        with sqlite3.connect(self.work / "cup-data/store.db") as store:
            for (config,) in store.execute(
                    "SELECT content_json FROM config WHERE hash IN (SELECT config FROM submission)"):
                if json.loads(config).get("phase") == "final":
                    return json.loads(config)["seeds"]
        return self.fail("the final has no config")

    # --- the challenge ---

    def test_a_challenge_is_held_from_the_manual_alone(self):
        self.prepare()
        self.warm_up()
        self.play_the_final()
        self.try_what_must_not_work()
        self.change_the_rules()
        self.play_further_episodes()
        self.freeze()
        self.close_and_reveal()

    def prepare(self):
        self.follow(2, SERVER)
        self.follow(3, SERVER)
        self.schedule(opens_at=FUTURE, freeze_at="2099-01-02T00:00:00Z",
                      closes_at="2099-01-03T00:00:00Z")
        self.follow(5, SERVER)
        self.assertEqual(self.phase(self.ask_server("phase status"))["state"], "upcoming")
        self.follow(6, SERVER)
        for team in WALKERS:
            self.assertEqual((self.work / f"{team}.token").stat().st_mode & 0o777, 0o600)
        self.follow(6, SERVER, 1)
        for team in WALKERS:
            shutil.copy(self.work / "cup/cert.pem", self.home(team))
            shutil.copy(self.work / "cup-key.pem", self.home(team))
            shutil.move(self.work / f"{team}.token", self.home(team))

    def warm_up(self):
        for team in WALKERS:
            # One policy for all: each must have bytes of its own only in the final.
            self.follow(7, PARTICIPANT, 0, team)
        board = self.ask_laptop("alpha", "leaderboard --phase warm-up")
        ranks = {row["team"]: row["rank"] for row in board["rows"]}
        self.assertIsNone(ranks.pop("organisers"), "a baseline has no rank")
        self.assertEqual(sorted(ranks), sorted(WALKERS))
        self.refused(self.on_laptop("alpha", "myograde submit policies/alpha-walker --phase final "
                                    "--team alpha"), "opens at")

    def play_the_final(self):
        self.schedule(opens_at=PAST, freeze_at=FUTURE, closes_at="2099-01-03T00:00:00Z")
        for team in ("alpha", "beta"):
            self.follow(7, PARTICIPANT, 1, team)
        self.follow(8, SERVER)

    def try_what_must_not_work(self):
        mine, theirs = (self.ask_laptop(team, "status")["submissions"][0]
                        ["submission"] for team in ("alpha", "beta"))
        there = self.refused(self.on_laptop("alpha", f"myograde show {theirs}"))
        missing = self.refused(self.on_laptop("alpha", "myograde show 4711"))
        self.assertEqual(there.replace(str(theirs), "N"), missing.replace("4711", "N"))
        for words in (f"proof receipt {theirs} -o their-receipt.json", f"cancel {theirs}",
                      f"rerun {theirs}", "submit policies/alpha-walker --phase warm-up --team beta",
                      "quota --team beta", "token list", "team ban beta --reason envy",
                      "phase pause final --reason tired", "board rejudge list", "phase seeds reveal --phase final",
                      f"submission disqualify {theirs} --reason envy", "store backup stolen.db", "events"):
            with self.subTest(words=words):
                self.refused(self.on_laptop("alpha", f"myograde {words}"))
        self.refused(self.on_server("myograde phase seeds reveal --phase final --reason early"), "close")
        self.refused(self.on_laptop("alpha", "MYOGRADE_TOKEN=myo_" + "0" * 64 + " myograde whoami"))
        self.assertEqual(self.ask_laptop("beta", f"show {theirs}")["state"], "done")
        self.look_for_seeds("alpha", mine)

    def change_the_rules(self):
        """In the section without a number."""
        before = self.ask_server("leaderboard --phase final")
        said = self.follow(0, SERVER, 0)
        self.assertIn("2 of 2 results; from facts 2, played 0", said)
        self.assertEqual(self.ask_server("leaderboard --phase final"), before)
        self.refused(self.on_laptop("alpha", "myograde board rejudge show 1"), "organisers")
        self.follow(0, SERVER, 1)
        after = self.ask_laptop("alpha", "leaderboard --phase final")
        self.assertNotEqual(after["config"], before["config"])
        self.assertEqual(after["rules"]["time_from_m"], 10)
        self.assertEqual(self.teams_on(after), self.teams_on(before))
        self.assertIn("applied", self.follow(0, SERVER, 2))
        self.assertEqual(self.ask_laptop("alpha", "leaderboard --phase final"), after)

    def play_further_episodes(self):
        """In the second section without a number."""
        before = self.ask_server("leaderboard --phase final")
        said = self.follow(0, SERVER, 3)
        self.assertIn("2 further episodes of 2 submissions", said)
        self.assertTrue(self.ask_server("board rejudge list")["rejudges"][0]["complete"])
        rows = self.ask_server("leaderboard --phase final --statistics")["rows"]
        self.assertEqual([row["further_episodes"] for row in rows], [2, 2])
        self.assertEqual(self.ask_server("leaderboard --phase final"), before)
        self.refused(self.on_laptop("alpha", "myograde board evaluate --phase final --more-seeds 9"),
                     "organisers")

    def look_for_seeds(self, team, submission):
        """Nothing that a participant can ask for has a seed of the final in it."""
        answers = ""
        for words in (f"show {submission} --episodes", f"status {submission}", "phase status",
                      "leaderboard --phase final", f"quota --team {team}", "status", "whoami"):
            answers += self.works(self.on_laptop(team, f"myograde {words} --json"))
            answers += self.works(self.on_laptop(team, f"myograde {words}"))
        # An answer that is refused must not say it either.
        for words in (f"proof receipt {submission} -o early.json", f"episode log {submission} --episode 0 -o l",
                      f"rerun {submission}"):
            done = self.on_laptop(team, f"myograde {words}")
            answers += done.stdout + done.stderr
            self.assertEqual(done.returncode, 2, f"{words}\n{done.stdout}{done.stderr}")
        for seed in self.seeds():
            self.assertNotIn(str(seed), answers)
            self.assertNotIn(f"{seed:x}", answers)

    def freeze(self):
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self.schedule(opens_at=PAST, freeze_at=now, closes_at=FUTURE)
        self.follow(7, PARTICIPANT, 1, "gamma")
        self.assertEqual(self.teams_on(self.ask_server("leaderboard --phase final")),
                         ["alpha", "beta", "gamma"])
        self.assertEqual(self.teams_on(self.ask_laptop("gamma", "leaderboard --phase final")),
                         ["alpha", "beta"])

    def close_and_reveal(self):
        self.schedule(opens_at=PAST, freeze_at="2020-01-02T00:00:00Z",
                      closes_at="2020-01-03T00:00:00Z")
        self.refused(self.on_laptop("gamma", "myograde submit policies/gamma-elbow --phase final "
                                    "--team gamma"), "closed")
        self.follow(9, SERVER)
        for team in WALKERS:
            submission = self.ask_laptop(team, "status")["submissions"][0]
            self.assertEqual(submission["phase"], "final")
            said = self.follow(9, PARTICIPANT, 0, team, SUBMISSION=str(submission["submission"]))
            self.assertNotIn("can't be checked", said)
        rows = self.ask_laptop(team, f"show {submission['submission']} --episodes")
        self.assertEqual([row["seed"] for row in rows["episode_rows"]], self.seeds())
        self.follow(10, SERVER)
        self.refused(self.on_laptop("alpha", "myograde whoami"), "revoked")
        # The last section without a number but one.
        self.follow(0, SERVER, -1)
        shutil.copytree(self.work / "cup-record", self.home("alpha") / "cup-record")
        said = self.follow(0, PARTICIPANT, -1, "alpha")
        self.assertIn("The record holds.", said)
        # Nobody but organisers sees results that no board ever had.
        withheld = json.loads((self.work / "cup-record/withheld.json").read_text())["receipts"]
        self.assertEqual({entry["withheld"]["reason"] for entry in withheld}, {"rejudge"})
        self.assertIn(f"({len(withheld)} withheld)", said)
