"""Results can be reproduced: logs, replays, reruns, receipts, seeds, golden Merkle roots."""

import hashlib
import json
import os
import pathlib
import shutil
import struct
import subprocess

from system import BIN, POLICIES, SOURCE, SystemTest, track_config

TRACKS = ("manipulation", "locomotion", "elbow", "reorientation", "baoding", "relocation",
          "chasetag")
CACHE = os.environ["MYOGRADE_CACHE"]
GOLDEN = SOURCE / "tests/golden/submissions"


def short_config(track, **changes):
    """As track_config; an evasion could last for 20 s."""
    if track == "chasetag":
        changes["rules"] = {"max_steps": 100}
    return track_config(track, **changes)


def flip(path, place, bit=1):
    data = bytearray(path.read_bytes())
    data[place % len(data)] ^= bit
    path.write_bytes(data)


class Proof(SystemTest):
    references = TRACKS
    tracks = {f"short-{track}": short_config(track) for track in TRACKS}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_daemon()
        cls.submissions = {}
        for track in TRACKS:
            result = cls.ask("submit", POLICIES / "random", "--track", f"short-{track}",
                             "--team", "Proof", "--wait")
            cls.submissions[track] = result["submission"]
        cls.key = cls.root / "key.pem"
        cls.run_cli("proof", "key", "-o", cls.key)

    def verify(self, receipt, *words):
        result = self.run_cli("verify", receipt, "--key", self.key, *words, "--json", check=False)
        return result.returncode, json.loads(result.stdout)

    def wrong(self, report):
        return [check["name"] for check in report["checks"] if not check["valid"]]

    def test_logs_are_lcm_logs_and_named_by_their_content(self):
        for track, size in (("manipulation", 80), ("locomotion", 55)):
            with self.subTest(track=track):
                submission = self.submissions[track]
                file = self.root / f"{track}.lcmlog"
                told = self.ask("episode", "log", submission, "--episode", 1, "-o", file)
                row = self.ask("show", submission, "--episodes")["episode_rows"][1]
                self.assertEqual(told["sha256"], row["log"]["sha256"])
                found = subprocess.run(["sha256sum", file], capture_output=True, text=True,
                                       check=True).stdout.split()[0]
                self.assertEqual(found, row["log"]["sha256"])
                self.assertTrue((self.data / "logs" / f"{found}.lcmlog.zst").exists())
                self.assertEqual(row["log"]["steps"], row["steps"])
                self.check_events(file, row, size)

    def check_events(self, file, row, size):
        """With LCM's own reader, in the Python for which the policies' runtime is built."""
        script = """
import json, sys, lcm
from myograde import action_t, step_digest_t
counts, last = {}, {}
for event in lcm.EventLog(sys.argv[1], "r"):
    counts[event.channel] = counts.get(event.channel, 0) + 1
    last[event.channel] = event
action = action_t.decode(last["MYOGRADE_ACTION"].data)
digest = step_digest_t.decode(last["MYOGRADE_LOG_DIGEST"].data)
print(json.dumps([counts["MYOGRADE_ACTION"], action.episode, action.step, action.size,
                  bytes(digest.state).hex(), last["MYOGRADE_LOG_END"].timestamp]))
"""
        runtime = json.loads((SOURCE / "configs/server.json").read_text())["runtimes"]["python"]
        paths = f"{runtime['path'].replace('${cache}', CACHE)}:{POLICIES / 'kit-python'}"
        said = subprocess.run(["/usr/bin/python3", "-c", script, file], capture_output=True,
                              text=True, env=dict(os.environ, PYTHONPATH=paths))
        self.assertEqual(said.returncode, 0, said.stderr)
        period_us = 10000 if size == 80 else 5000
        self.assertEqual(json.loads(said.stdout),
                         [row["steps"], 1, row["steps"] - 1, size, row["digest"][:16],
                          row["steps"] * period_us])

    def test_replays_are_equal_with_and_without_the_daemon(self):
        for track, submission in self.submissions.items():
            with self.subTest(track=track):
                whole = self.ask("episode", "replay", submission)
                self.assertTrue(whole["equal"], whole)
                self.assertEqual([entry["index"] for entry in whole["episodes"]], [0, 1, 2])
                file = self.root / f"replay-{track}.lcmlog"
                self.run_cli("episode", "log", submission, "--episode", 2, "-o", file)
                self.assertTrue(self.ask("episode", "replay", file)["equal"])

    def test_episodes_can_be_drawn_from_their_logs(self):
        for track in ("locomotion", "elbow"):  # boards of two kinds
            submission = self.submissions[track]
            with self.subTest(track=track):
                file = self.root / f"{track}.png"
                told = self.ask("episode", "render", submission, "--strip", "--size", "64x48", "-o", file)
                rows = self.ask("show", submission, "--episodes")["episode_rows"]
                self.assertEqual([entry["place"] for entry in told["episodes"]],
                                 ["best", "median", "worst"])
                self.assertEqual(sorted(entry["index"] for entry in told["episodes"]), [0, 1, 2])
                for entry in told["episodes"]:
                    row = rows[entry["index"]]
                    self.assertTrue(entry["verdict"].startswith(row["outcome"]), entry)
                # Five columns and three rows, 4 pixels apart.
                head = file.read_bytes()[:24]
                self.assertEqual(struct.unpack(">II", head[16:]), (5 * 64 + 16, 3 * 48 + 8))

    def test_episodes_of_carried_over_state_are_drawn_together(self):
        graded = self.ask("submit", POLICIES / "zero", "--track", "short-manipulation", "--profile", "as-graded",
                          "--team", "Carried", "--wait")
        told = self.ask("episode", "render", graded["submission"], "--strip", "--size", "64x48", "-o", self.root / "carried.png")
        self.assertEqual(sorted(entry["index"] for entry in told["episodes"]), [0, 1, 2])

    def test_an_altered_log_is_found_and_named(self):
        submission = self.submissions["locomotion"]
        file = self.root / "altered.lcmlog"
        self.run_cli("episode", "log", submission, "--episode", 0, "-o", file)
        flip(file, file.stat().st_size // 2)
        result = self.run_cli("episode", "replay", file, "--json", check=False)
        self.assertEqual(result.returncode, 1)
        episode = json.loads(result.stdout)["episodes"][0]
        self.assertEqual(episode["differs"], ["log"])

        hash_of = self.ask("show", submission, "--episodes")["episode_rows"][0]["log"]["sha256"]
        stored = self.data / "logs" / f"{hash_of}.lcmlog.zst"
        good = stored.read_bytes()
        try:
            flip(stored, len(good) // 2)
            result = self.run_cli("episode", "replay", submission, "--json", check=False)
            self.assertEqual(result.returncode, 1)
            entries = json.loads(result.stdout)["episodes"]
            self.assertEqual([entry["equal"] for entry in entries], [False, True, True])
            refused = self.run_cli("episode", "log", submission, "--episode", 0, "-o", self.root / "x",
                                   check=False)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("altered", refused.stderr)
        finally:
            stored.write_bytes(good)

    def test_a_local_run_gives_the_daemons_bytes(self):
        """The policy takes all its randomness from its policy seeds."""
        for track, submission in self.submissions.items():
            with self.subTest(track=track):
                shown = self.ask("show", submission, "--episodes")
                padded = self.root / f"padded-{track}"
                shutil.copytree(POLICIES / "random", padded)
                (padded / "padding").write_bytes(b"luck")
                local = self.ask("local", padded, "--track", f"short-{track}", "--slots", 1)
                self.assertNotEqual(local["hashes"]["artefact"], shown["hashes"]["artefact"])
                self.assertEqual([row["digest"] for row in local["episodes"]],
                                 [row["digest"] for row in shown["episode_rows"]])
                self.assertEqual(local["merkle_root"], shown["merkle_root"])

    def test_a_rerun_is_verified(self):
        again = self.ask("rerun", self.submissions["locomotion"], "--verify")
        self.assertTrue(again["verify"]["same"], again["verify"])
        self.assertEqual(len(again["verify"]["episodes"]), 3)

    def test_a_policy_that_is_not_repeatable_is_told_from_the_simulator(self):
        folder = self.python_policy("unrepeatable", ["policy.py"])
        (folder / "policy.py").write_text(
            "import os, myograde\n"
            "class Chance(myograde.Policy):\n"
            "    def act(self, observation):\n"
            "        return [b / 256 for b in os.urandom(54)] + [0.0]\n"
            "myograde.serve(Chance())\n")
        submission = self.ask("submit", folder, "--track", "short-locomotion", "--team", "Chance",
                              "--wait")["submission"]
        result = self.run_cli("rerun", submission, "--verify", "--json", check=False)
        self.assertEqual(result.returncode, 1, result.stderr)
        verify = json.loads(result.stdout)["verify"]
        self.assertEqual(verify["verdict"], "policy")
        self.assertEqual({entry["step"] for entry in verify["episodes"]}, {0})
        self.assertTrue(self.ask("episode", "replay", submission)["equal"], "the simulator is repeatable")

    def test_receipts_hold_and_forgeries_are_named(self):
        submission = self.submissions["manipulation"]
        receipt = self.root / "receipt.json"
        self.run_cli("proof", "receipt", submission, "-o", receipt)
        shown = self.ask("show", submission)
        status, report = self.verify(receipt, "--resimulate", 2)
        self.assertEqual((status, report["valid"]), (0, True), report)
        self.assertEqual(report["merkle_root"], shown["merkle_root"])
        self.assertEqual(len(report["resimulated"]), 2)

        self.assertEqual(self.run_cli("verify", receipt, check=False).returncode, 2)
        forged = self.root / "forged.json"
        body = json.loads(receipt.read_text())
        body["receipt"]["episodes"][0]["outcome"] = "success"
        forged.write_text(json.dumps(body, sort_keys=True, separators=(",", ":"),
                                     ensure_ascii=False) + "\n")
        status, report = self.verify(forged)
        self.assertEqual(status, 1)
        self.assertIn("signature", self.wrong(report))
        self.assertIn("merkle_root", self.wrong(report))
        text = receipt.read_bytes()
        for place in range(0, len(text), max(1, len(text) // 7)):
            forged.write_bytes(text)
            flip(forged, place)
            self.assertEqual(self.verify(forged)[0], 1, f"byte {place}")

    def test_another_key_and_another_log_are_named(self):
        submission = self.submissions["locomotion"]
        receipt = self.root / "receipt-2.json"
        self.run_cli("proof", "receipt", submission, "-o", receipt)
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out",
                        self.root / "other.key"], check=True, capture_output=True)
        subprocess.run(["openssl", "pkey", "-in", self.root / "other.key", "-pubout", "-out",
                        self.root / "other.pem"], check=True, capture_output=True)
        result = self.run_cli("verify", receipt, "--key", self.root / "other.pem", "--json",
                              check=False)
        self.assertEqual(self.wrong(json.loads(result.stdout)), ["signature"])
        file = self.root / "receipt-log.lcmlog"
        self.run_cli("episode", "log", submission, "--episode", 0, "-o", file)
        self.assertEqual(self.verify(receipt, "--logs", file)[0], 0)
        flip(file, file.stat().st_size - 200)
        status, report = self.verify(receipt, "--logs", file)
        self.assertEqual(status, 1)
        self.assertTrue(self.wrong(report)[0].startswith("log "))

    def test_a_swapped_model_is_named(self):
        receipt = self.root / "receipt-3.json"
        self.run_cli("proof", "receipt", self.submissions["locomotion"], "-o", receipt)
        cache = self.root / "cache"
        cache.mkdir()
        for part in pathlib.Path(CACHE).iterdir():
            if part.name != "models":
                (cache / part.name).symlink_to(part)
        shutil.copytree(f"{CACHE}/models", cache / "models")
        models = sorted((cache / "models").glob("locomotion-*.mjb"))
        self.assertTrue(models, "no compiled model is there")
        other = next((cache / "models").glob("manipulation-*.mjb"))
        for model in models:
            shutil.copy(other, model)  # a valid file, but not the one that its name says
        report = json.loads(self.run_cli(
            "verify", receipt, "--key", self.key, "--resimulate", 1, "--cache", cache, "--json",
            check=False).stdout)
        self.assertFalse(report["valid"])
        self.assertIn(f"model {models[0].name}", self.wrong(report))


def with_other_states(log):
    """The bytes of a complete log in which half of the states differ."""
    data = bytearray(log)
    name, places = b"MYOGRADE_LOG_DIGEST", []
    place = data.find(name)
    while place >= 0:
        places.append(place)
        place = data.find(name, place + 1)
    for place in places[len(places) // 2:]:
        size = int.from_bytes(data[place - 4:place], "big")
        data[place + len(name) + size - 1] ^= 1
    last = data.rfind(b"\xed\xa1\xda\x01")
    text = data[data.index(b"{", last):data.rindex(b"}") + 1]
    end = json.loads(text)
    del end["checksum"]
    body = json.dumps(end, sort_keys=True, separators=(",", ":"))
    before = hashlib.sha256(bytes(data[:last])).hexdigest()
    end["checksum"] = hashlib.sha256((before + body).encode()).hexdigest()
    return bytes(data).replace(
        bytes(text), json.dumps(end, sort_keys=True, separators=(",", ":")).encode())


class Reference(SystemTest):
    """A daemon on a host that computes other states than the reference episodes have."""

    tracks = {"short-locomotion": track_config("locomotion")}

    def test_a_host_of_other_states_grades_practice_only(self):
        stored = self.root / "configs/reference/locomotion.lcmlog.zst"
        log = subprocess.run(["zstd", "-dc", stored], capture_output=True, check=True).stdout
        subprocess.run(["zstd", "-qf", "-", "-o", stored], input=with_other_states(log), check=True)
        self.start_daemon()
        submit = ["submit", POLICIES / "zero", "--track", "short-locomotion", "--team", "A"]
        refused = self.run_cli(*submit, check=False)
        self.assertEqual(refused.returncode, 4, refused.stderr)
        self.assertIn("reference episode locomotion.lcmlog.zst", refused.stderr)
        self.assertEqual(self.ask(*submit, "--episodes", 1, "--wait")["state"], "done")


class Seeds(SystemTest):
    def test_seeds_are_fixed_ahead_and_checked_afterwards(self):
        secret, listed = self.root / "phase.secret", self.root / "seeds.json"
        committed = self.ask("phase", "seeds", "commit", "--phase", "final", "--count", 20, "--secret",
                             secret, "-o", listed)
        self.assertEqual(os.stat(secret).st_mode & 0o777, 0o600)
        self.assertNotIn("secret", committed)
        self.assertNotIn("seeds", committed)
        again = self.ask("phase", "seeds", "commit", "--phase", "final", "--count", 20, "--secret", secret)
        self.assertEqual(again["commitment"], committed["commitment"])
        shown = self.ask("phase", "seeds", "reveal", "--phase", "final", "--count", 20, "--secret", secret)
        self.assertEqual(shown["seeds"], json.loads(listed.read_text()))
        self.assertEqual(len(set(shown["seeds"])), 20)
        digits = subprocess.run(["sha256sum"], input=shown["secret"], capture_output=True,
                                text=True, check=True).stdout.split()[0]
        self.assertEqual(digits, committed["commitment"], "anybody can check the commitment")
        check = ["phase", "seeds", "check", "--phase", "final", "--count", 20, "--commitment",
                 committed["commitment"], "--seeds-sha256", committed["seeds_sha256"],
                 "--seeds", listed]
        self.assertTrue(self.ask(*check, "--secret", shown["secret"])["valid"])
        other = "0" * 64
        result = self.run_cli(*check, "--secret", other, "--json", check=False)
        self.assertEqual(result.returncode, 1)
        self.assertEqual(len(json.loads(result.stdout)["wrong"]), 3)
        self.assertNotEqual(
            self.ask("phase", "seeds", "reveal", "--phase", "other", "--count", 20, "--secret",
                     secret)["seeds"], shown["seeds"], "a phase has a list of its own")


class Golden(SystemTest):
    """Submissions of fixed bytes: one Merkle root with any number of workers."""

    tracks = {f"golden-{track}": short_config(track, episodes_per_lease=2) for track in TRACKS}

    def folder(self, track):
        return self.python_policy(f"golden-{track}", ["player.py"], GOLDEN / "player.py",
                                  GOLDEN / track / "actions.gz")

    def test_one_merkle_root_with_any_number_of_workers(self):
        recorded = json.loads((GOLDEN / "merkle_roots.json").read_text())
        changes = (SOURCE / "CHANGELOG.md").read_text()
        for track, root in recorded.items():
            self.assertIn(root[:12], changes, f"{track}: CHANGELOG.md must tell of this root")
        for track in TRACKS:
            # The workers are not the track's, so all their numbers are tried with two tracks only.
            roots = {self.ask("local", self.folder(track), "--track", f"golden-{track}", "--slots", slots)["merkle_root"]
                     for slots in ((1, 2, 5) if track in TRACKS[:2] else (2,))}
            self.assertEqual(roots, {recorded[track]},
                             f"{track}: results differ from those of earlier versions. If that is "
                             "meant, change merkle_roots.json and say in CHANGELOG.md what changes "
                             "for participants.")


class Processors(SystemTest):
    """The same states whatever processor features the C library sees."""

    tracks = {f"short-{track}": short_config(track) for track in TRACKS}
    PINNED = "-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX"

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.logs = {}
        for track in TRACKS:
            folder = cls.root / f"logs-{track}"
            row = cls.ask("local", POLICIES / "random", "--track", f"short-{track}",
                          "--episodes", 1, "--logs", folder)["episodes"][0]
            cls.logs[track] = folder / row["log"]["file"]

    def replay(self, track, before=(), **environment):
        result = subprocess.run(
            [*before, BIN / "myograde-sim", "--replay", self.logs[track], CACHE],
            env=dict(self.environment, **environment), capture_output=True, text=True,
            timeout=1500)
        self.assertTrue(result.stdout, result.stderr)
        return json.loads(result.stdout)

    def test_features_masked_for_the_c_library(self):
        more = ("", ",-SSE4_1", ",-SSE4_2,-SSSE3", ",-ERMS,-BMI2,-AVX_Fast_Unaligned_Load",
                ",-SSE4_1,-SSE4_2,-SSSE3,-POPCNT,-BMI1,-BMI2,-LZCNT,-MOVBE,-ERMS,-RTM")
        for track in TRACKS:
            for features in more if track == "locomotion" else more[-1:]:
                with self.subTest(track=track, features=features):
                    record = self.replay(
                        track, GLIBC_TUNABLES=f"glibc.cpu.hwcaps={self.PINNED}{features}")
                    self.assertTrue(record["equal"], record)

    def test_the_simulator_pins_its_maths_itself(self):
        for value in ("", "glibc.cpu.hwcaps=-AVX2"):
            record = self.replay("locomotion", GLIBC_TUNABLES=value)
            self.assertTrue(record["equal"], record)

    def test_models_are_compiled_alike_everywhere(self):
        made = {}
        for name, value in (("none", ""), ("all", f"glibc.cpu.hwcaps={self.PINNED},-SSE4_1")):
            cache = self.root / f"cache-{name}"
            cache.mkdir()
            for part in pathlib.Path(CACHE).iterdir():
                if part.name != "models":
                    (cache / part.name).symlink_to(part)
            subprocess.run([BIN / "myograde-sim", "--compile-models", cache], check=True,
                           env=dict(self.environment, GLIBC_TUNABLES=value), timeout=300)
            made[name] = {file.name: file.read_bytes() for file in (cache / "models").iterdir()}
        self.assertEqual(made["none"].keys(), made["all"].keys())
        self.assertEqual(made["none"], made["all"])

    def test_processors_that_qemu_plays(self):
        qemu = shutil.which("qemu-x86_64") or shutil.which("qemu-x86_64-static")
        if qemu is None:
            self.skipTest("qemu-x86_64 is not installed (Debian's qemu-user)")
        if b"__asan_init" in (BIN / "myograde-sim").read_bytes():
            self.skipTest("a sanitizer's shadow is more than qemu-x86_64 can map")
        # MuJoCo's own build needs AVX, so older processors can't run it.
        for model in ("SandyBridge", "Haswell", "max"):
            with self.subTest(model=model):
                record = self.replay("locomotion", before=(qemu, "-cpu", model),
                                     GLIBC_TUNABLES=f"glibc.cpu.hwcaps={self.PINNED}")
                self.assertTrue(record["equal"], record)
