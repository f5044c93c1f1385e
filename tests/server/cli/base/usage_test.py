"""How the command line tool is used: help, mistakes on the command line, files that hold secrets.
usage: usage_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, SOURCE_DIR, VERBS, CliCase, myograde)


class UsageTest(CliCase):
    def test_every_verb_has_help_with_an_example(self):
        for verb in VERBS:
            done = myograde(*verb.split(), "--help")
            self.assertEqual(done.returncode, 0)
            self.assertIn(f"myograde {verb}", done.stdout)
            self.assertIn("Exit status", done.stdout)

    def test_participants_hear_of_blocks_of_episodes(self):
        for verb in ("submit", "status", "cancel", "leaderboard", "show", "rerun", "local", "spec"):
            self.assertNotRegex(myograde(verb, "--help").stdout, r"\b[Ll]eases?\b")
        text = re.sub(r"[a-z_]*lease_[a-z]+|episodes_per_lease", "",
                      myograde("spec", "--track", "locomotion").stdout)
        self.assertNotIn("lease", text)

    def test_wrong_use_is_told_in_one_sentence(self):
        self.refused(2, "", "paint")
        self.refused(2, "", "status", "--colour")
        self.refused(2, "", "submit", "x", "--team", "a")
        program = self.path("program", "#!/bin/sh\n", 0o755)
        for verb in (("local",), ("submit", "--team", "a")):
            for episodes in ("0", "-3", "1000000000", "many"):
                self.refused(2, "--episodes", *verb, program, "--track", "manipulation",
                             f"--episodes={episodes}")
                self.refused(2, "", *verb, program, "--track", "manipulation",
                             "--episodes", episodes)
        self.refused(2, "not a range", "rerun", "7", "--episodes", "9..3")
        self.refused(2, "running", "spec", "--track", "running")
        self.refused(2, "running", "local", program, "--track", "running")
        self.refused(2, "holiday", "spec", "--track", "manipulation", "--profile", "holiday")

    def test_foreign_text_does_nothing_to_a_terminal(self):
        tricks = ["\x1b[31mred", "bell\a", "back\r", "c1\x9b31m", "turned\u202e", "isolated\u2066",
                  "hidden\u200b", "soft\xad", "next\nmyograde: error: forged"]
        harmful = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\xad\u200b-\u200f\u202a-\u202e\u2060-\u206f]")

        def shown(*words):
            done = subprocess.run([f"{BIN_DIR}/myograde", *words], capture_output=True, timeout=60, check=False,
                                  env={**os.environ, "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs"})
            for text in (done.stdout.decode(), done.stderr.decode()):
                self.assertNotRegex(text, harmful, words)
                self.assertNotIn("\nmyograde: error: forged", text)
            return done

        for trick in tricks:
            missing = self.path(trick)
            for words in (("local", missing, "--track", "elbow"), ("episode", "replay", missing), ("verify", missing),
                          ("episode", "render", missing, "-o", self.path("x.png")),
                          ("episode", "render", missing, "-o", trick),
                          ("phase", "check", missing), ("store", "import", missing, "--data", self.path("d")),
                          ("spec", "--track", trick), ("submit", missing, "--track", "elbow", "--team", trick),
                          ("status", "--socket", missing), (trick,), ("status", f"--{trick}"), ("new", missing),
                          ("proof", "release", "verify", missing, "--key", missing), ("proof", "record", "verify", missing)):
                self.assertNotEqual(shown(*words).returncode, 0, words)
            # As the policy.json of somebody else: raw where JSON allows it, and escaped.
            for ascii_only in (True, False):
                for manifest in ({trick: 1}, {"name": trick, "command": ["./run"]}, {"command": [trick]},
                                 {"command": ["./run"], "runtimes": [trick]}):
                    folder = self.path("policy")
                    os.makedirs(folder, exist_ok=True)
                    with open(f"{folder}/policy.json", "w", encoding="utf-8") as file:
                        json.dump(manifest, file, ensure_ascii=ascii_only)
                    for more in ((), ("--json",)):
                        self.assertNotEqual(shown("local", folder, "--track", "elbow", "--episodes", "1",
                                                  *more).returncode, 0)
        os.unlink(f"{folder}/policy.json")
        os.rmdir(folder)
        # Bytes that are no UTF-8.
        self.assertIn(b"bad?name", shown("local", os.fsencode(self.path("")) + b"/bad\xffname", "--track", "elbow").stderr)
        # On standard output, of a verb that succeeds.
        key = shown("proof", "release", "key", "--secret", self.path("k\x1b[31m"), "-o", self.path("p\u202e"))
        self.assertIn(key.returncode, (0, 2))

    def test_output_that_cannot_be_written_is_an_error(self):
        for words in (("--version",), ("--help",), ("spec", "--track", "elbow", "--json"), ("submit", "--help"),
                      ("status", "--json", "--socket", self.path("none"))):
            for sink, why in ((open("/dev/full", "wb"), "No space left"), (None, "Bad file descriptor")):
                done = subprocess.run([f"{BIN_DIR}/myograde", *words], stdout=sink, text=True, timeout=60,
                                      stderr=subprocess.PIPE, check=False,
                                      preexec_fn=None if sink else lambda: os.close(1),
                                      env={**os.environ, "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs"})
                if words[0] == "status":  # nothing to print: the first error counts
                    self.assertEqual(done.returncode, 3)
                else:
                    self.assertEqual(done.returncode, 4, words)
                    self.assertRegex(done.stderr, f"error: standard output can't be written: {why}")
                if sink:
                    sink.close()

    def test_who_reads_no_further_ends_it_quietly(self):
        done = subprocess.run(["bash", "-c", f"set -o pipefail; '{BIN_DIR}/myograde' --help | true; "
                               "echo ${PIPESTATUS[0]}"], capture_output=True, text=True, timeout=60,
                              check=False)
        self.assertIn(int(done.stdout), (0, 141))
        self.assertEqual(done.stderr, "")

    def test_numbers_that_are_none(self):
        for verb in ("show", "status", "cancel", "rerun", "submission hide", "submission unhide",
                     "submission baseline"):
            for bad in ("abc", "0", "1.5", "9" * 30):
                self.refused(2, f'"{bad}" is not a submission\'s number', *verb.split(), bad)
        self.refused(2, "not an episode's number", "episode", "log", "7", "--episode", "abc", "-o", "x")
        self.assertLess(len(myograde("show", "x" * 5000).stderr), 200)

    def test_mistyped_words(self):
        self.refused(2, 'did you mean "submit"?', "sbmit", "x", "--track", "t")
        self.refused(2, 'did you mean "phase seeds commit"?', "phase", "seeds", "comit")
        self.refused(2, 'did you mean "submission disqualify"?', "disqualify", "7")
        self.refused(2, 'there is no verb "list"; "myograde --help" lists them', "list")
        self.refused(2, 'did you mean "--episodes"?', "show", "7", "--epsodes")
        self.refused(2, 'there is no verb "paint"; "myograde --help" lists them', "paint")
        self.refused(2, "no verb given")

    def test_bad_seed_files(self):
        program = self.path("program", "#!/bin/sh\n", 0o755)
        for text, sentence in (("", "has 0 seeds"), ("1\n1\n", "twice"), ("1\nx\n", "line 2"),
                               ("-1\n", "line 1"), ("[1, 2.5]", "entry 1 is 2.5"), ("[1", "JSON"),
                               (str(2**63), "must be a whole number from 0"),
                               ('{"first": 1}', "count")):
            self.refused(2, sentence, "local", program, "--track", "manipulation", "--seeds",
                         self.path("seeds", text))

    def test_secret_files_are_their_owners_alone(self):
        seeds, secret = self.path("seeds", "an old list\n"), self.path("secret")
        self.path("seeds.part", "somebody waits here\n", 0o666)
        with open(f"{seeds}.part", encoding="utf-8") as waiting:
            done = myograde("phase", "seeds", "commit", "--phase", "p", "--secret", secret, "-o", seeds,
                            "--count", "3")
            self.assertEqual(done.returncode, 0, done.stderr)
            waiting.seek(0)
            self.assertEqual(waiting.read(), "somebody waits here\n")
        for path in (seeds, secret):
            self.assertEqual(stat.S_IMODE(os.stat(path).st_mode), 0o600, path)
        self.assertFalse(os.path.exists(f"{seeds}.part"))
        with open(seeds, encoding="utf-8") as file:
            self.assertEqual(len(json.load(file)), 3)

    def test_the_daemons_config_errors_are_wrong_use(self):
        shutil.copytree(f"{SOURCE_DIR}/configs", self.path("configs"))
        self.path("configs/server.json", '{"slots": 0}')
        for args in (("--configs", self.path("configs")), ("--colour",)):
            done = subprocess.run([f"{BIN_DIR}/myograded", "--data", self.path("data"), *args],
                                  capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertRegex(done.stderr, "^myograded: error: .*\n$")
        self.assertFalse(os.path.exists(self.path("data")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
