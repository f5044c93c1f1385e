"""How the API and the tool report unreadable rows of the store. damage_test covers that everything
else goes on."""

import os
import signal
import sqlite3
import time
import unittest

from organiser_test import TRACK, OrganiserCase
from support.daemon import DaemonError


class DamagedStore(OrganiserCase):
    def damage(self, sql):
        """Bypasses triggers and checks, while the daemon has the store open."""
        with sqlite3.connect(self.data / "store.db", timeout=20) as db:
            db.execute("PRAGMA ignore_check_constraints = ON")
            triggers = db.execute("SELECT name, sql FROM sqlite_schema WHERE type = 'trigger' AND "
                                  "(name LIKE '%_fixed' OR name LIKE '%_final')").fetchall()
            for name, _ in triggers:
                db.execute(f"DROP TRIGGER {name}")
            self.assertGreater(db.execute(sql).rowcount, 0, sql)
            for _, trigger in triggers:
                db.execute(trigger)
        db.close()

    def count(self, table):
        with sqlite3.connect(self.data / "store.db", timeout=20) as db:
            found = db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
        db.close()
        return found

    def refused(self, method, path, body=None, table="config"):
        status, answer = self.call(method, path, body)
        self.assertEqual(status, 500, answer)
        self.assertEqual(answer["error"]["code"], "damaged_row")
        self.assertIn(f"{table} ", answer["error"]["message"])
        self.assertIn("of the store can't be read", answer["error"]["message"])
        return answer["error"]["message"]

    def test_a_config_that_cant_be_read_is_named_and_leaves_nothing_half_done(self):
        first = self.played("ok")
        waiting = self.submit("stubborn")
        kept = self.submit("stubborn", team="beta")
        other = self.submit("slow", team="gamma", profile="myosuite")
        artefact = self.upload("once")
        config = self.result(first)["hashes"]["config"]
        before = [self.count(table) for table in ("submission", "evaluation", "block", "ledger")]
        self.damage(f"UPDATE config SET content_json = '{{\"form\":1}}' WHERE hash = '{config}'")

        for part in ("result", "receipt"):
            self.assertIn(config, self.refused("GET", f"/v1/submissions/{first}/{part}"))
        self.refused("POST", f"/v1/submissions/{first}/rerun", {})
        self.refused("POST", "/v1/submissions",
                     {"artefact": artefact, "team": "delta", "track": TRACK})
        self.assertEqual(before, [self.count(table)
                                  for table in ("submission", "evaluation", "block", "ledger")])
        self.assertEqual(self.get(f"/v1/submissions/{first}")["state"], "done")
        self.assertEqual(len(self.get("/v1/submissions")["submissions"]), 4)
        self.assertEqual(self.places(), [(1, first)])
        status, answer = self.call("POST", f"/v1/submissions/{waiting}/cancel", {})
        self.assertEqual((status, answer["state"]), (200, "cancelled"))

        # After a restart.
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.start()
        ended = self.ended(kept)
        self.assertEqual(ended["state"], "grader_error")
        self.assertIn(f"config {config} of the store can't be read", ended["reason"])
        self.assertEqual(self.ended(other)["state"], "done")
        self.assertEqual(self.get("/v1/health")["unreadable"], [])

    def test_lists_and_boards_show_what_can_be_read_and_name_the_rest(self):
        first, second = self.played("ok"), self.played("ok", team="beta")
        evaluation = self.get(f"/v1/submissions/{first}")["evaluation"]
        self.damage("UPDATE episode SET facts_json = 'x' "
                    f"WHERE evaluation = {evaluation} AND idx = 3")
        self.damage("UPDATE ledger SET why = CAST(x'ff' AS TEXT) WHERE submission = "
                    f"{first} AND entry = 'charge'")
        self.refused("GET", f"/v1/submissions/{first}/result", table="episode")
        self.assertEqual(len(self.places()), 2, "its place rests on the view")
        rebuilt = self.ask("board", "rebuild", schema="leaderboard")
        self.assertEqual(rebuilt["rebuilt"], 1)
        self.assertEqual([(row["table"], row["key"]) for row in rebuilt["unreadable"]],
                         [("episode", f"{evaluation}/3")])
        board = self.board()
        self.assertEqual([row["submission"] for row in board["rows"]], [second])
        self.assertEqual([row["key"] for row in board["unreadable"]], [f"{evaluation}/3"])
        self.assertIn(f"Left out: episode {evaluation}/3 of the store",
                      self.cli("leaderboard", "--track", TRACK).stdout)
        quota = self.ask("quota", "--team", "alpha", "--track", TRACK, schema="quota")
        self.assertNotIn("charge", [row["entry"] for row in quota["ledger"]])
        self.assertIn("ledger ", self.daemon.log())

        self.damage(f"UPDATE evaluation SET state = 'asleep' WHERE id = {evaluation}")
        listed = self.ask("status", schema="status")
        self.assertEqual([row["submission"] for row in listed["submissions"]], [second])
        self.assertIn(f"evaluation {evaluation} of the store can't be read", self.daemon.log())
        self.refused("GET", f"/v1/submissions/{first}", table="evaluation")

        # Whole stores as files, including the damage.
        self.ask("store", "export", self.folder / "export.json", schema="export")
        self.ask("store", "backup", self.folder / "backup.db", schema="backup")
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.start()
        # The engine finds it once it has started.
        unreadable = self.wait("/v1/health", lambda body: body["unreadable"])["unreadable"]
        self.assertEqual([entry["evaluation"] for entry in unreadable], [evaluation])
        self.assertEqual(self.ended(self.submit("ok", team="late"))["state"], "done")

    def test_facts_that_lack_what_every_episode_has_are_a_damaged_row_like_any_other(self):
        first, second = self.played("ok"), self.played("ok", team="beta")
        evaluation = self.get(f"/v1/submissions/{first}")["evaluation"]
        self.damage(f"UPDATE episode SET facts_json = '{{}}' WHERE evaluation = {evaluation} AND idx = 3")
        self.damage(f"DELETE FROM standing WHERE evaluation = {evaluation}")
        self.refused("GET", f"/v1/submissions/{first}/result", table="episode")
        # A start, which makes again what the view lacks.
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.start()
        self.assertIn(f"episode {evaluation}/3 of the store can't be read", self.daemon.log())
        board = self.board()
        self.assertEqual([row["submission"] for row in board["rows"]], [second])
        self.assertEqual([row["key"] for row in board["unreadable"]], [f"{evaluation}/3"])
        self.assertEqual(self.ended(self.submit("ok", team="late"))["state"], "done")

    def test_a_digit_of_a_digest_is_neither_shown_nor_signed(self):
        first, second = self.played("ok"), self.played("ok", team="beta")
        evaluation = self.get(f"/v1/submissions/{first}")["evaluation"]
        digest = self.result(first)["episode_rows"][3]["digest"]
        wrong = ("1" if digest[0] == "0" else "0") + digest[1:]
        self.damage(f"UPDATE episode SET facts_json = replace(facts_json, '{digest}', '{wrong}') "
                    f"WHERE evaluation = {evaluation} AND idx = 3")
        for part in ("result", "receipt"):
            message = self.refused("GET", f"/v1/submissions/{first}/{part}", table="evaluation")
            self.assertIn(f"evaluation {evaluation} ", message)
            self.assertIn("hash", message)
        self.assertEqual(self.call("GET", f"/v1/submissions/{second}/receipt")[0], 200)
        self.assertEqual(self.places(), [(1, first), (2, second)], "the boards rest on the view")
        rebuilt = self.ask("board", "rebuild")
        self.assertEqual([row["key"] for row in rebuilt["unreadable"]], [str(evaluation)])
        out = self.folder / "export.json"
        self.ask("store", "export", out)
        refused = self.cli("store", "import", out, data=self.folder / "new", check=False)
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn(f"evaluation {evaluation} ", refused.stderr)
        # Not even if the row's own hash follows: the record has it, too.
        self.damage(f"UPDATE evaluation SET results_hash = '{'0' * 64}' WHERE id = {evaluation}")
        self.refused("GET", f"/v1/submissions/{first}/receipt", table="evaluation")

    def test_a_rejudge_names_once_what_all_its_boards_lack(self):
        number = self.ask("board", "rejudge", "create", "--track", "demo-locomotion", "--reason",
                          "once more", "--wait")["rejudge"]
        self.damage("INSERT INTO journal (at, kind, who, private_json) "
                    "VALUES (1, 'marked', 'uid 0', '{}')")
        changes = self.get(f"/v1/rejudges/{number}?changes=1")
        self.assertEqual([board["board"] for board in changes["boards"]], ["main", "physiological"])
        self.assertEqual([row["table"] for row in changes["unreadable"]], ["journal"])

    def test_a_damaged_evaluation_is_left_out_of_the_feed(self):
        first, second = self.played("ok"), self.played("ok", team="beta")
        evaluation = self.get(f"/v1/submissions/{first}")["evaluation"]
        self.damage(f"UPDATE evaluation SET grader_json = 'x' WHERE id = {evaluation}")
        self.assertIn("rank 2", self.feed())

    def test_a_store_that_is_gone_is_said_at_once(self):
        self.played("ok")
        for file in self.data.glob("store.db*"):
            file.unlink()
        trouble = self.wait("/v1/health", lambda body: body["status"] == "store")
        self.assertIn("was removed while the daemon runs", trouble["message"])
        status, answer = self.call("GET", "/v1/ready")
        self.assertEqual(status, 503, answer)
        artefact = ("0" * 64)
        status, answer = self.call("POST", "/v1/submissions",
                                   {"artefact": artefact, "team": "delta", "track": TRACK})
        self.assertNotIn(status, (200, 201), answer)
        status, answer = self.call("POST", "/v1/submissions/1/marks",
                                   {"mark": "hidden", "set": True, "reason": "r"})
        self.assertEqual(status, 503, answer)
        self.assertIn("removed", answer["error"]["message"])
        self.stop(signal.SIGKILL)
        self.start()
        self.assertIn("if the store was lost", self.daemon.log())
        self.stop(signal.SIGKILL)
        for file in self.data.glob("store.db*"):
            file.unlink()
        (self.data / "store.db").touch()
        before = len(self.daemon.log())
        self.start()
        self.assertIn("if the store was lost", self.daemon.log()[before:], "an empty file is no store either")

    def test_a_log_that_was_cut_off_is_said_at_once(self):
        self.played("ok")
        os.truncate(self.data / "store.db-wal", 0)
        trouble = self.wait("/v1/health", lambda body: body["status"] == "store")
        self.assertIn("write-ahead log was cut off", trouble["message"])
        self.assertEqual(self.call("GET", "/v1/ready")[0], 503)

    def test_an_older_store_in_its_file_is_said_at_once(self):
        self.played("ok")
        self.ask("store", "backup", self.folder / "backup.db")
        self.played("ok", team="beta")
        # What stays in the log, as a request was being answered or something was written since, would
        # be read in place of what the file says.
        log = self.data / "store.db-wal"
        backup = (self.folder / "backup.db").read_bytes()
        for _ in range(100):
            with sqlite3.connect(self.data / "store.db", timeout=20) as db:
                db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            db.close()
            if log.stat().st_size == 0:
                (self.data / "store.db").write_bytes(backup)
                break
            time.sleep(0.1)
        self.assertEqual(log.stat().st_size, 0)
        trouble = self.wait("/v1/health", lambda body: body["status"] == "store")
        self.assertIn("overwritten with an older store", trouble["message"])
        self.assertEqual(self.call("GET", "/v1/ready")[0], 503)

    def test_a_store_with_damaged_pages_is_not_opened(self):
        self.played("ok")
        with sqlite3.connect(self.data / "store.db", timeout=20) as db:
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            page = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'token'"
                              ).fetchone()[0]
            size = db.execute("PRAGMA page_size").fetchone()[0]
        db.close()
        self.stop(signal.SIGTERM)
        with open(self.data / "store.db", "r+b") as store:
            store.seek((page - 1) * size)
            store.write(b"\x55" * size)
        with self.assertRaisesRegex(DaemonError, "is damaged .*restore it from a backup"):
            self.start()


if __name__ == "__main__":
    unittest.main()
