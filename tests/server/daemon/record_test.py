"""The public record of a real daemon: exported, checked without it, and altered in every way."""

import hashlib
import json
import os
import shutil
import signal
import sqlite3
import unittest

from organiser_test import OrganiserCase


class RecordCase(OrganiserCase):
    def exported(self, name="record"):
        folder = self.folder / name
        self.said = self.ask("proof", "record", "export", folder, schema="record-export")
        return folder

    def key(self):
        path = self.folder / "organiser.pem"
        if not path.exists():
            self.cli("proof", "key", "-o", path)
        return path

    def verify(self, folder, *words):
        """Exit status and answer of verify --all; no daemon is asked."""
        done = self.daemon.run_verb("verify", "--all", folder, "--key", self.key(), *words, "--json",
                                    timeout_s=60, text=True)
        answer = json.loads(done.stdout)
        self.assertEqual(done.returncode,
                         1 if not answer["valid"] else 0 if answer["complete"] else 5, answer)
        self.assertEqual(answer["complete"], answer["valid"] and not answer["not_checked"], answer)
        return answer

    def holds(self, folder, *words):
        answer = self.verify(folder, *words)
        self.assertTrue(answer["complete"], answer)
        return answer

    def incomplete(self, folder, *words):
        """Nothing is wrong, and each of the words says what could not be checked."""
        answer = self.verify(folder)
        self.assertTrue(answer["valid"], answer["checks"])
        for word in words:
            self.assertTrue(any(word in what for what in answer["not_checked"]), answer)
        return answer

    def refuted(self, folder, name, words, *options):
        """One check is wrong, and says so in one sentence."""
        answer = self.verify(folder, *options)
        wrong = [check for check in answer["checks"] if not check["valid"]]
        self.assertEqual([check["name"] for check in wrong], [name], answer["checks"])
        self.assertIn(words, wrong[0]["detail"])
        self.assertNotIn("\n", wrong[0]["detail"])

    def altered(self, whole):
        """A copy to be altered."""
        copy = self.folder / "altered"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(whole, copy)
        return copy

    def damaged(self, statement):
        """Changes the store behind the daemon's back."""
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as store:
            store.execute("PRAGMA ignore_check_constraints = ON")
            for name, in store.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
                store.execute(f"DROP TRIGGER {name}")
            store.execute(statement)
        store.close()
        self.start()

    def entries(self):
        return [row["entry"] for row in self.get("/v1/record?limit=1000")["entries"]]

    def rewritten(self, edit):
        """What somebody with the store and the key can do: `edit` gets the list of entries, and the
        record is made of what it leaves, with a chain of its own."""
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as store:
            for name in ("TRIGGER IF EXISTS journal_fixed", "TRIGGER IF EXISTS journal_kept",
                         "INDEX IF EXISTS journal_by_evaluation"):
                store.execute(f"DROP {name}")
            rows = store.execute("SELECT at, kind, evaluation, entry_json, private_json FROM journal "
                                 "WHERE entry IS NOT NULL ORDER BY entry").fetchall()
            private = {row[3]: row[4] for row in rows}
            rows = edit([(*row[:3], json.loads(row[3])) for row in rows])
            store.execute("DELETE FROM journal")
            chain = ""
            for index, (at, kind, evaluation, entry) in enumerate(rows):
                text = json.dumps(entry, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
                chain = hashlib.sha256(f"{chain}\n{text}".encode()).hexdigest()
                store.execute("INSERT INTO journal (at, kind, who, evaluation, private_json, entry, "
                              "entry_json, chain) VALUES (?, ?, 'x', ?, ?, ?, ?, ?)",
                              (at, kind, evaluation, private.get(text, "{}"), index, text, chain))
        store.close()
        self.start()


def change(path, edit):
    """Rewrites a JSON file in its canonical form."""
    value = json.loads(path.read_text())
    edit(value)
    path.write_text(json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
                    + "\n")


class Records(RecordCase):
    def setUp(self):
        super().setUp()
        self.first = self.played("ok", "alpha")
        self.second = self.played("logged", "beta")
        self.played("crash", "gamma")
        self.played("ok", "alpha", episodes=2)

    def board_file(self, folder):
        files = list((folder / "boards").glob("*.main.json"))
        self.assertEqual(len(files), 1)
        return files[0]

    def test_every_alteration_is_found(self):
        self.cli("submission", "disqualify", self.second, "--reason", "reads the seeds")
        whole = self.exported()
        self.assertEqual((self.said["receipts"], self.said["withheld"]), (3, 0))
        self.assertEqual(self.holds(whole)["boards"], self.said["boards"])
        self.assertIn("The record holds.",
                      self.daemon.run_verb("verify", "--all", whole, "--key", self.key(),
                                           timeout_s=60, text=True).stdout)

        # One byte of every file, in its middle and at its end.
        for path in sorted(path for path in whole.rglob("*") if path.is_file()):
            text = path.read_bytes()
            for place in (len(text) // 2, len(text) - 1):
                copy = self.altered(whole)
                other = copy / path.relative_to(whole)
                other.write_bytes(text[:place] + bytes([text[place] ^ 1]) + text[place + 1:])
                answer = self.verify(copy)
                wrong = [check["detail"] for check in answer["checks"] if not check["valid"]]
                self.assertEqual(len(wrong), 1, f"{other}, byte {place}: {answer}")

        lines = (whole / "record.jsonl").read_text().splitlines(keepends=True)
        for words, altered in (("entries were removed", lines[:2] + lines[3:]),
                               ("more entries", lines + lines[-1:]),
                               ("the root", [lines[1], lines[0], *lines[2:]])):
            copy = self.altered(whole)
            (copy / "record.jsonl").write_text("".join(altered))
            self.refuted(copy, "entries", words)

        copy = self.altered(whole)
        receipts = sorted((copy / "receipts").iterdir())
        receipts[0].write_bytes(receipts[1].read_bytes())
        self.refuted(copy, "receipts", f"{receipts[0].name}: it is the receipt of a different evaluation")
        copy = self.altered(whole)
        receipts[0].unlink()
        self.refuted(copy, "receipts", "neither a receipt nor a line in withheld.json")
        copy = self.altered(whole)
        receipts[0].unlink()
        (copy / "withheld.json").write_text(
            '{"receipts":[{"evaluation":1,"reason":"phase"}]}\n')
        self.refuted(copy, "withheld", "was not signed with this key")

        def swap(board):
            board["rows"][0]["rank"] = 2

        def lose_row(board):
            board["rows"].clear()

        def pardon(board):
            board["disqualified"].clear()

        def flatter(board):
            board["rows"][0]["aggregate"]["success_rate"] = 1

        for edit, words in ((swap, "its /rows/0/rank is 2, but by the record it is 1"),
                            (lose_row, "its /rows/0 is missing"),
                            (pardon, "its /disqualified/0 is missing"),
                            (flatter, "its /rows/0/aggregate/success_rate is 1")):
            copy = self.altered(whole)
            change(self.board_file(copy), edit)
            self.refuted(copy, "boards", words)
        copy = self.altered(whole)
        self.board_file(copy).unlink()
        self.refuted(copy, "boards", "is missing")

    def test_no_copy_tells_an_artefacts_hash(self):
        hashes = [self.result(submission)["hashes"]["artefact"]
                  for submission in (self.first, self.second)]
        whole = self.exported()
        for path in whole.rglob("*"):
            for one in hashes if path.is_file() else ():
                self.assertNotIn(one.encode(), path.read_bytes(), path)
        receipt = json.loads((whole / "receipts/1.json").read_text())["receipt"]
        text = f"myograde artefact/{self.first}/{hashes[0]}"
        self.assertEqual(receipt["artefact"], hashlib.sha256(text.encode()).hexdigest())

    def test_a_winner_that_was_taken_out_is_found_and_damage_is_not_accused(self):
        sound = self.exported("sound")
        self.damaged("UPDATE episode SET facts_json = 'x' WHERE evaluation = 1 AND idx = 0")
        damaged = self.exported("damaged")
        self.assertEqual((self.said["receipts"], self.said["withheld"]), (2, 1))
        answer = self.incomplete(damaged, "the receipt of evaluation 1 is withheld: unreadable",
                                 "main.json: the receipt of evaluation 1 is withheld and may")
        self.assertEqual(answer["boards"], self.said["boards"] - answer["withheld"])
        line = json.loads((damaged / "withheld.json").read_text())["receipts"][0]
        self.assertEqual(line["withheld"]["head"],
                         json.loads((damaged / "head.json").read_text())["head"])

        def without_winner(signed):
            copy = self.altered(sound)
            (copy / "receipts/1.json").unlink()
            change(copy / "withheld.json", lambda withheld: withheld["receipts"].append(signed))
            change(self.board_file(copy), lambda board: board["rows"].pop(0))
            return copy

        other = {**line, "withheld": {**line["withheld"], "evaluation": 2}}
        for signed in ({"evaluation": 1, "reason": "unreadable"}, {**line, "signature": None}, other,
                       {**line, "signature": {**line["signature"], "value": "00" * 64}}):
            self.refuted(without_winner(signed), "withheld", "was not signed with this key")
        # A reason that was signed is of one record only.
        self.played("ok", "delta")
        grown = self.exported("grown")
        for lines, name, words in (
                ([line], "withheld", "was signed for a different record"),
                ([], "receipts", "neither a receipt nor a line in withheld.json")):
            copy = self.altered(grown)
            change(copy / "withheld.json", lambda withheld, lines=lines: withheld.update(receipts=lines))
            self.refuted(copy, name, words)

    def test_nothing_can_be_added_beside_a_signature(self):
        whole = self.exported()
        receipt = "receipts/1.json"
        for name, check, edit in (
                ("head.json", "head", lambda value: value["signature"].update(note="x")),
                (receipt, "receipts", lambda value: value["signature"].update(note="x")),
                (receipt, "receipts", lambda value: value.update(note="x")),
                ("withheld.json", "withheld", lambda value: value.update(note="x"))):
            copy = self.altered(whole)
            change(copy / name, edit)
            self.refuted(copy, check, "")

    def test_damage_beside_the_results_is_not_accused(self):
        self.cli("submission", "baseline", self.second)
        self.holds(self.exported("sound"))
        # What counts follows from the journal, and from no other row.
        self.damaged("UPDATE team SET banned = 4 WHERE name = 'alpha'")
        self.holds(self.exported("damaged"))

    def test_an_entry_twice_is_found(self):
        self.rewritten(lambda rows: rows + [row for row in rows if row[1] == "graded"][:1])
        self.refuted(self.exported(), "entries", "ends evaluation 1 a second time")

    def test_hostile_folders_are_refused(self):
        whole = self.exported()
        for make, words in (
                (lambda f: (f / "receipts/1.json").unlink() or
                 os.symlink("/etc/passwd", f / "receipts/1.json"), "is not a regular file"),
                (lambda f: os.mkfifo(f / "secrets/final.txt"), "is not a regular file"),
                (lambda f: (f / "more").write_text("x"), "does not belong in a record"),
                (lambda f: (f / "boards/\x1b[2J").write_text("x"), "does not belong in a record"),
                (lambda f: (f / "configs/deep").mkdir(), "is not a regular file")):
            copy = self.altered(whole)
            make(copy)
            self.refuted(copy, "folder", words)
        copy = self.altered(whole)
        (copy / "secrets/-final.txt").write_text("x")  # a name that a phase may have
        self.refuted(copy, "secrets", "secrets/-final.txt")
        copy = self.altered(whole)
        with open(copy / "head.json", "ab") as file:
            file.truncate(1 << 40)  # a hole
        self.refuted(copy, "head", "too large for such a file")
        copy = self.altered(whole)
        with open(copy / "record.jsonl", "wb") as file:
            file.truncate(1 << 40)
        self.refuted(copy, "entries", "line 1: is too long")
        copy = self.altered(whole)
        (copy / "withheld.json").write_text("[" * 100000)
        self.refuted(copy, "withheld", "not JSON in its canonical form")
        missing = self.daemon.run_verb("verify", "--all", self.folder / "none", "--key", self.key(),
                                       timeout_s=60, text=True)
        self.assertEqual(missing.returncode, 2, missing)
        again = self.cli("proof", "record", "export", whole, check=False)
        self.assertEqual((again.returncode, "is not empty" in again.stderr), (2, True), again)

    def test_a_record_that_was_written_anew_is_found_by_an_earlier_head(self):
        head = self.folder / "head.json"
        self.ask("proof", "record", "head", "-o", head, schema="record-head")
        self.cli("submission", "hide", self.first, "--reason", "private")
        proved = self.ask("proof", "record", "prove", "--since", head, schema="record-prove")
        self.assertTrue(proved["valid"])
        self.assertTrue(self.ask("proof", "record", "prove", 2, schema="record-prove")["valid"])
        self.holds(self.exported("before"), "--head", head)
        # The whole chain anew behind the daemon's back, with another key of a submission.
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as store:
            store.executescript(
                "DROP TRIGGER journal_fixed; UPDATE journal SET entry_json = "
                "replace(entry_json, '\"team\":\"beta\"', '\"team\":\"best\"') WHERE id = "
                "(SELECT min(id) FROM journal WHERE entry_json LIKE '%\"team\":\"beta\"%')")
        store.close()
        self.start()
        self.assertIn("the record was changed here", self.daemon.log())
        doctor = json.loads(self.cli("doctor", "--json", check=False).stdout)
        found = [check for check in doctor["checks"] if check["name"] == "record"]
        self.assertEqual([check["state"] for check in found], ["degraded"])
        forged = self.exported("forged")
        self.refuted(forged, "entries", "the chain of record.jsonl does not end")
        refused = self.cli("proof", "record", "prove", "--since", head, check=False)
        self.assertEqual(refused.returncode, 1, refused)
        # Somebody with the key signs a head of the altered record, chain and all: only whoever kept
        # an earlier head can tell.
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as store:
            chain = ""
            for index, text in store.execute(
                    "SELECT entry, entry_json FROM journal WHERE entry IS NOT NULL ORDER BY entry"
                    ).fetchall():
                chain = hashlib.sha256(f"{chain}\n{text}".encode()).hexdigest()
                store.execute("UPDATE journal SET chain = ? WHERE entry = ?", (chain, index))
        store.close()
        self.start()
        forged = self.exported("resigned")
        self.refuted(forged, "earlier_head", "rewritten in between", "--head", head)

    def test_an_edit_of_the_store_is_found(self):
        self.holds(self.exported("before"))
        self.damaged("INSERT INTO journal (at, kind, who, private_json) VALUES (1, 'marked', 'x', "
                     f"'{{\"mark\":\"hidden\",\"set\":true,\"submission\":{self.first}}}')")
        self.refuted(self.exported("after"), "boards", "its /rows/0")

    def test_receipts_refer_to_their_entry_and_stay_the_same(self):
        path = f"/v1/submissions/{self.first}/receipt"
        before = self.get(path)
        record = before["receipt"]["record"]
        self.assertEqual(record["size"], record["entry"] + 1)
        self.assertEqual(self.entries()[record["entry"]], record["content"])
        self.played("ok", "delta")
        self.assertEqual(self.get(path), before)
        self.assertNotIn("record", self.get("/v1/submissions/4/receipt")["receipt"], "practice")
        receipt = self.folder / "receipt.json"
        self.cli("proof", "receipt", self.first, "-o", receipt, "--evaluation", 1)
        checks = self.ask("verify", receipt, "--key", self.key(), schema="verify")["checks"]
        self.assertIn({"name": "record", "valid": True, "detail": f"entry {record['entry']}"}, checks)
        status, answer = self.call("GET", f"{path}?evaluation=2")
        self.assertEqual((status, answer["error"]["code"]), (404, "not_found"), answer)

    def test_pages_proofs_and_bad_questions(self):
        size = self.get("/v1/record")["size"]
        seen, path = [], "/v1/record?limit=2"
        while path:
            page = self.get(path)
            seen += [row["index"] for row in page["entries"]]
            path = page["next_from"] and f"/v1/record?limit=2&from={page['next_from']}"
        self.assertEqual(seen, list(range(size)))
        self.assertEqual(self.get(f"/v1/record?from={size + 5}")["entries"], [])
        head = self.get("/v1/record/head")["head"]
        self.assertEqual(head["size"], size)
        proof = self.get("/v1/record/proof?entry=0")
        self.assertEqual((proof["size"], proof["root"]), (size, head["root"]))
        growth = self.get("/v1/record/consistency?from=1")
        self.assertEqual((growth["to"], growth["to_root"]), (size, head["root"]))
        for path in (f"proof?entry={size}", "proof", "proof?entry=3&size=2", "proof?entry=-1",
                     "consistency", f"consistency?from=1&to={size + 1}", "consistency?from=3&to=2",
                     "head?x=1", "proof?entry=0&size=x"):
            status, answer = self.call("GET", f"/v1/record/{path}")
            self.assertEqual((status, answer["error"]["code"]), (400, "bad_request"), path)
        self.ask("proof", "record", "show", "--from", 1, "--limit", 3, schema="record-show")
        self.assertIn("accepted, submission 1", self.cli("proof", "record", "show").stdout)

    def test_an_imports_record_goes_on(self):
        before = self.entries()
        self.cli("store", "export", self.folder / "all.json")
        other = self.folder / "other"
        self.cli("store", "import", self.folder / "all.json", data=other)
        with sqlite3.connect(other / "store.db") as store:
            after = [json.loads(row[0]) for row in
                     store.execute(
                         "SELECT entry_json FROM journal WHERE entry IS NOT NULL ORDER BY entry")]
        store.close()
        self.assertEqual(after[:len(before)], before)


if __name__ == "__main__":
    unittest.main()
