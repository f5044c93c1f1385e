"""Takes EvalAI's submissions through the server. A submission has a row in the state's file and goes from step
to step. What a step does may be repeated, and then it writes down that it is done, so that the process may be
killed at any moment."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import sqlite3
import sys
import time
import urllib.parse
from typing import Any

from ..client import MyogradeError, Unreachable, WrongUse, band_openers
from . import verdict
from .evalai import Evalai, EvalaiError
from .settings import Settings

# A row's steps: new, sending, grading or withdrawn, done. `status` is what EvalAI was told last, or "withdrawn" if
# EvalAI itself has ended it.
SCHEMA = """CREATE TABLE IF NOT EXISTS submission (
  pk INTEGER PRIMARY KEY, phase TEXT NOT NULL, step TEXT NOT NULL DEFAULT 'new', attempt INTEGER NOT NULL DEFAULT 0,
  team TEXT, artefact TEXT, sent_at REAL, number INTEGER, refusal TEXT, status TEXT, digest TEXT,
  starts INTEGER NOT NULL DEFAULT 0);
CREATE TABLE IF NOT EXISTS team (pk INTEGER PRIMARY KEY, name TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, value TEXT NOT NULL)"""
REPORT_AGAIN = """UPDATE submission SET step = 'grading' WHERE step = 'done' AND status != 'withdrawn'
  AND phase IN (SELECT value FROM json_each(?)) AND number IS NOT NULL
  AND (? OR number IN (SELECT value FROM json_each(?)))"""
OPEN = ("submitted", "queued", "resuming", "running")
SURVEY_S, LONGEST_WAIT_S, KEY_S, MESSAGES, MOST_STARTS = 900, 600, 20 * 3600, 3, 5
NO_SERVER = ("no_token", "bad_token", "redirect", "unreadable")  # with such answers, nothing else works either
OURS = "Cancelled on EvalAI"  # how the reason begins why something is withdrawn here


class Worker:
    def __init__(self, settings: Settings) -> None:
        if settings.evalai is None:
            raise WrongUse(f'{settings.file}: "evalai" is missing')
        self.settings, self.client, self.evalai = settings, settings.client(), Evalai(settings)
        self.challenge = f"jobs/challenge/{settings.evalai.challenge}"
        self.queue = urllib.parse.quote(settings.evalai.queue, safe="")
        file = settings.file.with_suffix(".sqlite")
        self.state = sqlite3.connect(file, isolation_level=None, timeout=1)
        self.state.row_factory = sqlite3.Row
        try:
            # The lock is kept from here on.
            self.state.executescript(f"PRAGMA locking_mode = EXCLUSIVE; BEGIN IMMEDIATE; {SCHEMA}; COMMIT")
        except sqlite3.OperationalError as error:
            raise WrongUse(f"{file}: can't be used, perhaps as another connector works with it ({error})") from error
        self.surveyed_at, self.followed, self.trouble = -float(SURVEY_S), -1, ""
        self.receipts: dict[int, str] = {}  # by pk what deletes its message; a lost one comes again with the message
        self.waits: dict[int, tuple[int, float]] = {}  # by pk how often it was tried, and when it is tried again
        self.follow_record()  # now, as it finds what is wrong with the phases

    def run(self) -> None:
        while True:
            pause_s, trouble = self.settings.poll_s, ""
            try:
                self.turn()
            except (MyogradeError, sqlite3.Error) as error:
                pause_s, trouble = max(pause_s, getattr(error, "pause_s", 0)), f"{error}; it is tried again"
            if trouble != self.trouble:
                print(trouble or "all is well again", file=sys.stderr)
            self.trouble = trouble
            time.sleep(pause_s)

    def turn(self) -> None:
        for _ in range(MESSAGES):
            message = self.evalai.ask("GET", f"jobs/challenge/queues/{self.queue}/")
            if not message or not message["body"]:
                break
            pk = message["body"]["submission_pk"]
            self.receipts[pk] = message["receipt_handle"]
            self.reconcile(pk, message["body"]["phase_pk"])
        self.follow_record()
        unfinished = {pk for (pk,) in self.rows("SELECT pk FROM submission WHERE step != 'done'")}
        for pk in sorted(unfinished | self.receipts.keys()):
            self.advance(pk)
        if time.monotonic() - self.surveyed_at > SURVEY_S:
            self.survey()

    def survey(self) -> None:
        """Finds what the queue has lost, and what EvalAI has cancelled without a message."""
        for status in (*OPEN, "cancelled"):
            for found in self.evalai.ask("GET", f"{self.challenge}/submission/?status={status}") or []:
                self.reconcile(found["id"], found["challenge_phase"], status)
        self.surveyed_at = time.monotonic()

    def reconcile(self, pk: int, phase: int, status: str = "") -> None:
        """A submission that is new here, or one that may have been cancelled or resumed since."""
        for row in self.rows("SELECT * FROM submission WHERE pk = ?", pk):
            status = status or self.status(pk)
            if status in OPEN and row["step"] == "done":
                self.save(row, "new", attempt=row["attempt"] + 1, refusal=None, number=None, status=None, digest=None)
            elif status == "cancelled" and row["status"] not in ("cancelled", "withdrawn") and row["step"] != "sending":
                self.save(row, "withdrawn")
            return
        if status != "cancelled":
            self.rows("INSERT INTO submission (pk, phase) VALUES (?, ?)", pk, str(phase))

    def follow_record(self) -> None:
        """Has reported again what marks, bans, rejudges, other columns or other bands may have changed. What EvalAI was
        told already is not sent again."""
        kept = dict(self.rows("SELECT name, value FROM kept"))
        size, touched = self.client.changed_since(int(kept["record"]) if kept else None)
        if size == self.followed:
            return
        bands = [band_openers(board) for target in self.settings.phases.values()
                 for board in verdict.boards_of(self.client, target).values()]
        columns = repr((self.settings.phases, bands))
        everything = touched is None or columns != kept["columns"]
        self.rows(REPORT_AGAIN, json.dumps([*self.settings.phases]), everything, json.dumps([*(touched or ())]))
        self.rows("INSERT OR REPLACE INTO kept VALUES ('record', ?), ('columns', ?)", size, columns)
        self.followed = size  # what came meanwhile is read with the next turn

    def advance(self, pk: int) -> None:
        """Takes it as far as it goes now."""
        while self.waits.get(pk, (0, 0.0))[1] <= time.monotonic():
            (row,) = self.rows("SELECT * FROM submission WHERE pk = ?", pk)
            try:
                getattr(self, f"do_{row['step']}")(row)
                if row["step"] == "done":
                    return
            except (MyogradeError, OSError, LookupError, TypeError, ValueError) as error:
                code = getattr(error, "code", "")
                if code in NO_SERVER or isinstance(error, Unreachable):
                    raise
                if row["step"] == "sending" and code == "not_found":
                    self.save(row, "new")  # the upload was not kept for so long
                elif row["step"] in ("new", "sending") and not getattr(error, "passes", True):
                    self.save(row, "grading", refusal=str(error))
                else:  # or an answer that none would expect
                    tries = self.waits.get(pk, (0, 0.0))[0]
                    wait_s = min(LONGEST_WAIT_S, self.settings.poll_s * 2 ** min(tries, 10))
                    print(f"EvalAI's submission {pk}: {error}; trying again in {wait_s:.0f} s", file=sys.stderr)
                    self.waits[pk] = tries + 1, time.monotonic() + wait_s

    def save(self, row: sqlite3.Row, step: str, **values: Any) -> None:
        self.waits.pop(row["pk"], None)
        self.rows(f"UPDATE submission SET step = ?{''.join(f', {key} = ?' for key in values)} WHERE pk = ?",
                  step, *values.values(), row["pk"])

    def rows(self, sql: str, *values: Any) -> list[sqlite3.Row]:
        return self.state.execute(sql, values).fetchall()

    def status(self, pk: int) -> str:
        """What EvalAI says; what is gone there counts as cancelled."""
        return (self.evalai.ask("GET", f"jobs/submission/{pk}") or {"status": "cancelled"})["status"]

    def do_new(self, row: sqlite3.Row) -> None:
        """Fetches the file and uploads it."""
        found = self.evalai.ask("GET", f"jobs/submission/{row['pk']}")
        if found is None or found["status"] not in OPEN:
            return self.save(row, "done", status="withdrawn")
        target, most = self.settings.target(row["phase"]), self.settings.largest_bytes
        team = self.team(found["participant_team"], found["participant_team_name"])
        folder = self.settings.file.with_suffix(".download")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        # Whoever sends a file that ends this process does not hold up the others for ever.
        self.rows("UPDATE submission SET starts = starts + 1 WHERE pk = ?", row["pk"])
        try:
            if row["starts"] >= MOST_STARTS:
                raise WrongUse(f"the connector was killed {MOST_STARTS} times as it packed this; tell the organisers")
            path = self.evalai.download(found["input_file"] or "", folder, most)
            artefact = self.client.upload(path, team=team, track=target.track, phase=target.phase,
                                          check_runtimes=False, largest_bytes=most)["artefact"]
        except WrongUse as error:
            raise WrongUse(str(error).replace(f"{folder}/", "")) from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            self.rows("UPDATE submission SET starts = 0 WHERE pk = ?", row["pk"])
        self.save(row, "sending", team=team, artefact=artefact, sent_at=time.time())

    def team(self, pk: int, name: str) -> str:
        """The team's name here. It is made at first sight; one that somebody else has made is not given away."""
        if known := self.settings.teams.get(str(pk)) or dict(self.rows("SELECT pk, name FROM team")).get(pk):
            return known
        reason, name = f"EvalAI's participant team {pk} of {self.evalai.server}"[:200], " ".join(name.split())
        made = self.client.make_team(name, f"{name} ({pk})", f"EvalAI team {pk}", reason=reason)["team"]
        self.rows("INSERT INTO team VALUES (?, ?)", pk, made)
        return made

    def do_sending(self, row: sqlite3.Row) -> None:
        """Submits it. An answer that was lost is known by the key, for a day, and after that by the artefact."""
        target, number = self.settings.target(row["phase"]), None
        where = {"team": row["team"], "track": target.track, "phase": target.phase}
        for known in self.client.submissions(**where) if time.time() - row["sent_at"] > KEY_S else ():
            if known["artefact"] == row["artefact"] and not self.rows(
                    "SELECT 1 FROM submission WHERE number = ?", known["submission"]):
                number = known["submission"]
        if number is None:
            number = self.client.submit_artefact(
                row["artefact"], **where, profile=target.profile, episodes=target.episodes,
                key=f"{self.evalai.server}/{self.challenge}/{row['pk']}/{row['attempt']}")["submission"]
        self.client.readmit(number, OURS)  # if it is run again
        self.evalai.ask("PATCH", f"{self.challenge}/update_submission/",
                        {"submission": row["pk"], "submission_status": "running"})
        self.save(row, "grading", number=number)

    def do_grading(self, row: sqlite3.Row) -> None:
        """Reports its end, unless EvalAI has cancelled it or was told the same before."""
        body = {"challenge_phase": row["phase"], "submission": row["pk"], "submission_status": "failed",
                "stdout": " ", "stderr": row["refusal"]}
        if row["refusal"] is None:
            page = self.client.page_of(row["number"], self.settings.myograde.pages)
            ended = verdict.judge(self.client, self.settings.target(row["phase"]), row["number"], page)
            if ended is None:
                waiting = len(self.rows("SELECT 1 FROM submission WHERE step = 'grading'"))
                self.waits[row["pk"]] = 0, time.monotonic() + self.settings.poll_s * (1 + waiting // 20)
                return
            results = [{"split": split, "show_to_participant": ended["shown"]["aggregate"], "accuracies": columns}
                       for split, columns in ended["columns"].items()]
            about = {"submission": row["number"], "page": page, "evaluation": ended["result"]["evaluation"],
                     "hashes": ended["result"]["hashes"]}
            body.update(submission_status=ended["kind"], stdout=ended["stdout"], stderr=ended["stderr"] or " ",
                        result=json.dumps(results), metadata=json.dumps(about))
        digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
        if digest != row["digest"]:
            if self.status(row["pk"]) == "cancelled" != row["status"]:
                return self.save(row, "withdrawn")
            self.evalai.ask("PUT", f"{self.challenge}/update_submission/", body)
        self.save(row, "done", status=body["submission_status"], digest=digest)

    def do_withdrawn(self, row: sqlite3.Row) -> None:
        """EvalAI has cancelled it, so it is taken back here, unless another one of EvalAI's is the same here."""
        same = "SELECT 1 FROM submission WHERE number = ? AND pk != ? AND status IS NOT 'withdrawn'"
        if row["number"] and not self.rows(same, row["number"], row["pk"]):
            self.client.withdraw(row["number"], f"{OURS} (submission {row['pk']})")
        self.save(row, "done", status="withdrawn")

    def do_done(self, row: sqlite3.Row) -> None:
        """EvalAI's queue need not deliver it any more."""
        with contextlib.suppress(EvalaiError):  # too old a receipt: the queue delivers the message again, with another
            if receipt := self.receipts.pop(row["pk"], None):
                self.evalai.ask("POST", f"jobs/queues/{self.queue}/", {"receipt_handle": receipt})
