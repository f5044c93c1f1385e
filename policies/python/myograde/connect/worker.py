"""Takes EvalAI's submissions through the server. A submission has a row in the state's file and goes from step
to step. What a step does may be repeated, and then it writes down that it is done, so that the process may be
killed at any moment."""

from __future__ import annotations

import errno
import hashlib
import json
import shutil
import sqlite3
import sys
import time
import urllib.parse
import zipfile
from typing import Any

from ..client import FINAL_STATES, MyogradeError, ServerError, WrongUse
from . import mapping, verdict
from .evalai import Evalai, EvalaiError
from .settings import Settings

Row = sqlite3.Row
# A row's steps: new, sending, grading or withdrawn, done. `status` is what EvalAI was told last, or "withdrawn" if
# EvalAI itself has ended it.
SCHEMA = """CREATE TABLE IF NOT EXISTS submission (
  pk INTEGER PRIMARY KEY, phase TEXT NOT NULL, step TEXT NOT NULL DEFAULT 'new', attempt INTEGER NOT NULL DEFAULT 0,
  team TEXT, artefact TEXT, sent_at REAL, number INTEGER, refusal TEXT, status TEXT, digest TEXT,
  starts INTEGER NOT NULL DEFAULT 0);
CREATE TABLE IF NOT EXISTS team (pk INTEGER PRIMARY KEY, name TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, value TEXT NOT NULL)"""
OPEN = ("submitted", "queued", "resuming", "running")
SURVEY_S, LONGEST_WAIT_S, KEY_S, MESSAGES, MOST_STARTS = 900, 600, 20 * 3600, 3, 5
CHANGES = ("banned", "unbanned", "published", "revealed", "applied", "dropped")  # events of the public record
OURS = "Cancelled on EvalAI"  # how the reason of a mark begins that was set here


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
            self.state.execute("PRAGMA locking_mode = EXCLUSIVE")
            self.state.executescript(f"BEGIN IMMEDIATE; {SCHEMA}; COMMIT")  # the lock is kept from here on
        except sqlite3.OperationalError as error:
            raise WrongUse(f"{file}: can't be used, perhaps as another connector works with it ({error})") from error
        self.surveyed_at, self.followed, self.trouble = -float(SURVEY_S), -1, ""
        self.receipts: dict[int, str] = {}  # by pk what deletes its message; a lost one comes again with the message
        self.waits: dict[int, tuple[int, float]] = {}  # by pk how often it was tried, and when it is tried again
        tracks = {track["track"] for track in self.client.tracks()}
        for pk, target in settings.phases.items():
            if self.client.track_of(target.track, target.phase) not in tracks:
                raise WrongUse(f'{settings.file}, phases, {pk}: {self.client.server} has no track "{target.track}"')

    def run(self) -> None:
        while True:
            pause_s, trouble = self.settings.poll_s, ""
            try:
                self.turn()
            except MyogradeError as error:
                pause_s, trouble = max(pause_s, getattr(error, "pause_s", 0)), f"{error}; it is tried again"
            if trouble != self.trouble:
                print(trouble or "all is well again", file=sys.stderr, flush=True)
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
        """Has reported again what marks, bans, rejudges, other columns or other bands may have changed."""
        size = self.client.ask("/v1/record/head")["head"]["size"]
        if size == self.followed:
            return
        boards = [verdict.boards_of(self.client, target) for target in self.settings.phases.values()]
        bands = [mapping.openers_of(board) for shown in boards for board in shown.values()]
        columns, kept = repr((self.settings.phases, bands)), dict(self.rows("SELECT name, value FROM kept"))
        begin, touched, everything = int(kept.get("record", size)), set(), columns != kept.get("columns", columns)
        while begin < size:
            for entry in self.client.ask(f"/v1/record?from={begin}&limit=1000")["entries"]:
                begin, act = entry["index"] + 1, entry["entry"]
                touched.add(act["submission"] if act["kind"] == "marked" else None)
                everything = everything or act["kind"] == "config" or act.get("event") in CHANGES
        with self.state:
            self.rows("BEGIN")
            for row in self.rows("SELECT * FROM submission WHERE step = 'done' AND status != 'withdrawn'"):
                if row["number"] and (everything or row["number"] in touched) and row["phase"] in self.settings.phases:
                    self.save(row, "grading")
            for name, value in (("record", begin), ("columns", columns)):
                self.rows("INSERT OR REPLACE INTO kept VALUES (?, ?)", name, str(value))
        self.followed = size  # what came meanwhile is read with the next turn

    def advance(self, pk: int) -> None:
        """Takes it as far as it goes now."""
        while self.waits.get(pk, (0, 0.0))[1] <= time.monotonic():
            (row,) = self.rows("SELECT * FROM submission WHERE pk = ?", pk)
            try:
                if row["step"] == "done":
                    return self.do_done(pk)
                getattr(self, f"do_{row['step']}")(row)
            except (WrongUse, ServerError, EvalaiError, KeyError, TypeError, ValueError) as error:
                code, status = getattr(error, "code", ""), getattr(error, "status", 0)
                full = getattr(error.__cause__, "errno", 0) in (errno.ENOSPC, errno.EDQUOT, errno.EIO)
                passes = full or code == "paused" or status == 408 or status >= 429
                if code in ("no_token", "bad_token"):
                    raise  # nothing else works either
                if row["step"] == "sending" and code == "not_found":
                    self.save(row, "new")  # the upload was not kept for so long
                elif row["step"] in ("new", "sending") and isinstance(error, (WrongUse, ServerError)) and not passes:
                    self.save(row, "grading", refusal=str(error))
                else:  # or an answer that none would expect
                    self.later(row, error)

    def later(self, row: Row, why: Exception) -> None:
        tries = self.waits.get(row["pk"], (0, 0.0))[0]
        wait_s = min(LONGEST_WAIT_S, self.settings.poll_s * 2 ** min(tries, 10))
        print(f"EvalAI's submission {row['pk']}: {why}; trying again in {wait_s:.0f} s", file=sys.stderr, flush=True)
        self.waits[row["pk"]] = tries + 1, time.monotonic() + wait_s

    def save(self, row: Row, step: str, **values: Any) -> None:
        values = {"step": step, **values}
        self.waits.pop(row["pk"], None)
        self.rows(f"UPDATE submission SET {', '.join(f'{key} = ?' for key in values)} WHERE pk = ?",
                  *values.values(), row["pk"])

    def rows(self, sql: str, *values: Any) -> list[Row]:
        return self.state.execute(sql, values).fetchall()

    def status(self, pk: int) -> str:
        """What EvalAI says; what is gone there counts as cancelled."""
        return (self.evalai.ask("GET", f"jobs/submission/{pk}") or {"status": "cancelled"})["status"]

    def mark_hidden(self, number: int, hidden: bool, **reason: str) -> None:
        self.client.ask(f"/v1/submissions/{number}/marks", {"mark": "hidden", "set": hidden, **reason})

    def target(self, row: Row) -> Any:
        if row["phase"] not in self.settings.phases:
            raise WrongUse(f"EvalAI's phase {row['phase']} is not graded here; tell the organisers")
        return self.settings.phases[row["phase"]]

    def do_new(self, row: Row) -> None:
        """Fetches the file and uploads it."""
        found = self.evalai.ask("GET", f"jobs/submission/{row['pk']}")
        if found is None or found["status"] not in OPEN:
            return self.save(row, "done", status="withdrawn")
        target, most = self.target(row), self.settings.largest_bytes
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
            if zipfile.is_zipfile(path):
                with zipfile.ZipFile(path) as archive:
                    if sum(entry.file_size for entry in archive.infolist()) > most:
                        raise WrongUse(f"unpacked, the submission has more than {most} bytes; make it smaller")
            artefact = self.client.upload(path, team=team, track=target.track, phase=target.phase,
                                          check_runtimes=False)["artefact"]
        except WrongUse as error:
            raise WrongUse(str(error).replace(f"{folder}/", "")) from error.__cause__
        except MyogradeError:
            raise
        except Exception as error:  # whatever Python's own library makes of a stranger's archive
            raise WrongUse(f"the file can't be read as a submission ({error})") from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            self.rows("UPDATE submission SET starts = 0 WHERE pk = ?", row["pk"])
        self.save(row, "sending", team=team, artefact=artefact, sent_at=time.time())

    def team(self, pk: int, name: str) -> str:
        """The team's name here. It is made at first sight; one that somebody else has made is not given away."""
        if known := self.settings.teams.get(str(pk)) or dict(self.rows("SELECT pk, name FROM team")).get(pk):
            return known
        reason, name = f"EvalAI's participant team {pk} of {self.evalai.server}"[:200], " ".join(name.split())
        for given in (name, f"{name} ({pk})", f"EvalAI team {pk}"):
            try:
                made = self.client.ask("/v1/teams", {"team": given, "reason": reason})
            except ServerError as error:
                if error.code not in ("bad_request", "conflict", "look_alike"):
                    raise
                if error.code != "conflict":
                    continue
                made = self.client.ask(f"/v1/teams/{urllib.parse.quote(given, safe='')}")  # by us, before a kill?
            if any(act["event"] == "created" and act["reason"] == reason for act in made["events"]):
                self.rows("INSERT INTO team VALUES (?, ?)", pk, made["team"])
                return made["team"]
        raise WrongUse(f"no team could be made for EvalAI's {name!r}; tell the organisers")

    def do_sending(self, row: Row) -> None:
        """Submits it. An answer that was lost is known by the key, for a day, and after that by the artefact."""
        target, number = self.target(row), None
        where = {"team": row["team"], "track": target.track, "phase": target.phase}
        for known in self.client.submissions(**where) if time.time() - row["sent_at"] > KEY_S else ():
            if known["artefact"] == row["artefact"] and not self.rows(
                    "SELECT 1 FROM submission WHERE number = ?", known["submission"]):
                number = known["submission"]
        if number is None:
            number = self.client.submit_artefact(
                row["artefact"], **where, profile=target.profile, episodes=target.episodes,
                key=f"{self.evalai.server}/{self.challenge}/{row['pk']}/{row['attempt']}")["submission"]
        hidden = verdict.marks_of(self.client.status(number)).get("hidden")
        if hidden and (hidden["reason"] or "").startswith(OURS):  # it is run again
            self.mark_hidden(number, False)
        self.evalai.ask("PATCH", f"{self.challenge}/update_submission/",
                        {"submission": row["pk"], "submission_status": "running"})
        self.save(row, "grading", number=number)

    def do_grading(self, row: Row) -> None:
        """Reports its end, unless EvalAI has cancelled it or was told the same before."""
        body = {"challenge_phase": row["phase"], "submission": row["pk"], "submission_status": "failed",
                "stdout": " ", "stderr": row["refusal"]}
        if row["refusal"] is None:
            page = self.settings.page(self.client, row["number"])
            ended = verdict.judge(self.client, self.target(row), row["number"], page)
            if ended is None:
                waiting = len(self.rows("SELECT 1 FROM submission WHERE step = 'grading'"))
                self.waits[row["pk"]] = 0, time.monotonic() + self.settings.poll_s * (1 + waiting // 20)
                return
            results = [{"split": split, "show_to_participant": ended.show["aggregate"], "accuracies": columns}
                       for split, columns in ended.columns.items()]
            about = {"submission": row["number"], "page": page, "evaluation": ended.result["evaluation"],
                     "hashes": ended.result["hashes"]}
            body.update(submission_status=ended.status, stdout=ended.stdout, stderr=ended.stderr or " ",
                        result=json.dumps(results), metadata=json.dumps(about))
        digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
        if digest != row["digest"]:
            if self.status(row["pk"]) == "cancelled" != row["status"]:
                return self.save(row, "withdrawn")
            self.evalai.ask("PUT", f"{self.challenge}/update_submission/", body)
        self.save(row, "done", status=body["submission_status"], digest=digest)

    def do_withdrawn(self, row: Row) -> None:
        """EvalAI has cancelled it, so it is taken back here, unless another one of EvalAI's is the same here."""
        same = "SELECT 1 FROM submission WHERE number = ? AND pk != ? AND status IS NOT 'withdrawn'"
        if row["number"] and not self.rows(same, row["number"], row["pk"]):
            why, status = f"{OURS} (submission {row['pk']})", self.client.status(row["number"])
            if status["state"] not in FINAL_STATES and status["episodes"]["done"] == 0:
                self.client.cancel(row["number"], why)
            elif status["ranked"]:  # a cancel after the first episode would keep the content from being graded again
                self.mark_hidden(row["number"], True, reason=why)
        self.save(row, "done", status="withdrawn")

    def do_done(self, pk: int) -> None:
        """EvalAI's queue need not deliver it any more."""
        try:
            if receipt := self.receipts.pop(pk, None):
                self.evalai.ask("POST", f"jobs/queues/{self.queue}/", {"receipt_handle": receipt})
        except EvalaiError:
            pass  # a receipt that is too old: the queue delivers the message again, with another one
