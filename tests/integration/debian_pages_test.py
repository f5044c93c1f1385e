"""What the Debian packages hold beside programs: manual pages, completions and units, checked by the
tools that read them, where they are installed."""

import gzip
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
DEBIAN = SOURCE / "docker/debian"
UNITS = DEBIAN / "systemd"
# In tenths, as systemd-analyze takes it.
MOST_EXPOSED = 29


def run(*words, **options):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=120,
                          stdin=subprocess.DEVNULL, **options)


def needs(tool):
    return unittest.skipUnless(shutil.which(tool), f"{tool} is not installed")


class Pages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-pages-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        made = run(sys.executable, "-B", DEBIAN / "pages.py", "1.2.3", BIN, SOURCE, cls.folder,
                   env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"})
        if made.returncode != 0:
            raise AssertionError(made.stderr)
        told = run(BIN / "myograde", "--help").stdout
        cls.verbs = re.findall(r"^  ([a-z]+)", told, re.MULTILINE)

    def served(self):
        """Variables under which a daemon has two phases, and the tracks are the source's."""
        program = self.folder / "programs/myograde"
        program.parent.mkdir(exist_ok=True)
        program.write_text("#!/bin/sh\necho '{\"challenges\": [{\"phases\": "
                           "[{\"phase\": \"dev\"}, {\"phase\": \"final\"}]}]}'\n")
        program.chmod(0o755)
        return {"PATH": f"{program.parent}:{os.environ['PATH']}",
                "MYOGRADE_CONFIG_DIR": str(SOURCE / "configs")}

    def pages(self):
        return sorted(self.folder.glob("man*/*.gz"))

    def test_every_verb_program_and_file_has_a_page(self):
        names = {page.name for page in self.pages()}
        wanted = {f"myograde-{verb}.1.gz" for verb in self.verbs}
        self.assertGreater(len(wanted), 25)
        files = {f"myograde-{name}.5.gz" for name in ("server.json", "track", "challenge", "sandbox", "policy.json")}
        self.assertEqual(names, wanted | files | {"myograde.1.gz", "myograded.8.gz", "myograde-setup.8.gz"})

    def text_of(self, page):
        text = gzip.decompress((self.folder / page).read_bytes()).decode()
        return text.replace("\\-", "-").replace("\\(aq", "'")

    def test_no_page_names_a_folder_of_the_build(self):
        for page in self.pages():
            self.assertNotIn(str(BIN), self.text_of(page.relative_to(self.folder)), page.name)

    def test_the_pages_of_files_have_every_key(self):
        def keys(schema):
            """The names of all properties in a schema."""
            if isinstance(schema, list):
                schema = dict(enumerate(schema))
            if not isinstance(schema, dict):
                return
            yield from schema["properties"] if isinstance(schema.get("properties"), dict) else ()
            for name, inner in schema.items():
                # Of a phase it is server.json's, as its page says.
                if name != "statistics" or "ranks" not in str(inner.get("properties")):
                    yield from keys(inner)
        for page, schema in (("server.json", "server"), ("challenge", "challenge")):
            text = self.text_of(f"man5/myograde-{page}.5.gz")
            for key in keys(json.loads((SOURCE / f"configs/schema/{schema}.json").read_text())):
                self.assertIn(key, text, page)
        track = self.text_of("man5/myograde-track.5.gz")
        shipped = json.loads((SOURCE / "configs/tracks/manipulation.json").read_text())
        for key in (*shipped, *shipped["budgets"], *shipped["rules"], *shipped["scoring"]):
            if not key.startswith("//"):
                self.assertIn(key, track)
        sandbox = self.text_of("man5/myograde-sandbox.5.gz")
        for key in json.loads((SOURCE / "configs/sandbox/policy.json").read_text()):
            self.assertIn(key.removeprefix("//"), sandbox)
        for key in ("name", "command", "runtimes", "adapter", "env", "extra_observations"):
            self.assertIn(f"\\fB{key}\\fR", self.text_of("man5/myograde-policy.json.5.gz"))

    def test_pages_tell_options_and_their_day(self):
        text = gzip.decompress((self.folder / "man1/myograde-submit.1.gz").read_bytes()).decode()
        for words in (r"\-\-track", "2023-11-14", ".SH EXAMPLE", ".SH EXIT STATUS"):
            self.assertIn(words, text)
        config = gzip.decompress((self.folder / "man5/myograde-server.json.5.gz").read_bytes()).decode()
        self.assertIn("scheduler.max_retries", config)

    @needs("mandoc")
    def test_mandoc_finds_no_mistake(self):
        for page in self.pages():
            done = run("mandoc", "-Tlint", "-Wwarning", page)
            self.assertEqual((done.returncode, done.stdout), (0, ""), page.name)

    def test_bash_completes(self):
        def complete(*words):
            line = " ".join(f"'{word}'" for word in words)
            done = run("bash", "-c", f"source {self.folder}/completion/bash; COMP_WORDS=({line}); "
                       f"COMP_CWORD={len(words) - 1}; _myograde; echo ${{COMPREPLY[@]}}")
            return done.stdout.split()
        self.assertEqual(complete("myograde", "lead"), ["leaderboard"])
        self.assertEqual(complete("myograde", ""), [*self.verbs, "--help", "--version"])
        self.assertEqual(complete("myograde", "submit", "--tr"), ["--track"])
        self.assertEqual(complete("myograde", "team", "cr"), ["create"])
        self.assertEqual(complete("myograde", "team", "create", "--rea"), ["--reason"])
        self.assertEqual(complete("myograde", "board", "rejudge", "cr"), ["create"])
        self.assertEqual(complete("myograde", "board", "rejudge", "create", "--rep"), ["--repeat"])
        with unittest.mock.patch.dict(os.environ, self.served()):
            self.assertIn("elbow", complete("myograde", "submit", "--track", ""))
            self.assertEqual(complete("myograde", "submit", "--profile", "as"), ["as-graded"])
            self.assertEqual(complete("myograde", "submit", "--phase", ""), ["dev", "final"])

    @needs("fish")
    def test_fish_completes(self):
        def complete(line):
            done = run("fish", "--no-config", "-c",
                       f"source {self.folder}/completion/fish; complete -C '{line}'",
                       env={**os.environ, "HOME": str(self.folder)})
            return [entry.split("\t")[0] for entry in done.stdout.splitlines()]
        self.assertEqual(complete("myograde lead"), ["leaderboard"])
        self.assertEqual(complete("myograde submit --tra"), ["--track"])
        self.assertEqual(complete("myograde team cre"), ["create"])
        with unittest.mock.patch.dict(os.environ, self.served()):
            self.assertIn("elbow", complete("myograde submit --track "))
            self.assertEqual(complete("myograde submit --profile as"), ["as-graded"])
            self.assertEqual(complete("myograde submit --phase "), ["dev", "final"])

    @needs("zsh")
    def test_zsh_completes(self):
        # The widget's builtins tell what they were given.
        def complete(*words):
            line = " ".join(f"'{word}'" for word in words)
            done = run("zsh", "-f", "-c",
                       "_describe() { print -rl -- ${(P)2%%:*} }; compadd() { print -rl -- ${(P)2} }; _files() { }; "
                       f"words=({line}); CURRENT={len(words)}; f() {{ source {self.folder}/completion/zsh }}; f")
            self.assertEqual(done.returncode, 0, done.stderr)
            return done.stdout.split()
        self.assertIn("submit", complete("myograde", ""))
        self.assertIn("--track", complete("myograde", "submit", ""))
        self.assertIn("create", complete("myograde", "team", ""))
        self.assertIn("--reason", complete("myograde", "team", "create", ""))
        with unittest.mock.patch.dict(os.environ, self.served()):
            self.assertIn("elbow", complete("myograde", "submit", "--track", ""))
            self.assertIn("as-graded", complete("myograde", "submit", "--profile", ""))
            self.assertEqual(complete("myograde", "submit", "--phase", ""), ["dev", "final"])

    def test_a_heading_that_is_missing_is_named(self):
        source = self.folder / "renamed"
        for page in ("configs/README.md", "configs/challenges/README.md", "server/artefact/README.md"):
            (source / page).parent.mkdir(parents=True)
            shutil.copy(SOURCE / page, source / page)
        for name in ("server.json", "sandbox"):
            (source / "configs" / name).symlink_to(SOURCE / "configs" / name)
        document = source / "configs/README.md"
        whole = document.read_text(encoding="utf-8")
        make = "import pathlib, sys, pages; print(len(pages.file_pages(pathlib.Path(sys.argv[1]), '')))"

        def made():
            return run(sys.executable, "-B", "-c", make, source, env={**os.environ, "PYTHONPATH": str(DEBIAN)})
        self.assertEqual(made().stdout, "5\n")
        # The first heading of a part, and the one that ends it.
        for heading in ("## Track configs", "## Reference episodes"):
            document.write_text(whole.replace(f"\n{heading}\n", "\n## Renamed\n"), encoding="utf-8")
            done = made()
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, f'^pages.py: {document} has no heading "{heading}".*\n$')

    def test_conffiles_are_the_configs(self):
        listed = (self.folder / "control/server/conffiles").read_text().split()
        self.assertEqual(listed, ["/etc/logrotate.d/myograde", "/etc/myograde/sandbox/policy.json",
                                  "/etc/myograde/sandbox/sim.json", "/etc/myograde/server.json"])

    def exposure(self, *drop_ins):
        """What systemd-analyze says of the daemon's unit with these files beside it."""
        root = self.folder / "-".join(("exposed", *drop_ins))
        units = root / "etc/systemd/system"
        (units / "myograded.service.d").mkdir(parents=True)
        shutil.copy(UNITS / "myograded.service", units)
        for name in drop_ins:
            shutil.copy(UNITS / name, units / "myograded.service.d")
        return run("systemd-analyze", "security", "--offline=yes", f"--root={root}", "--no-pager",
                   f"--threshold={MOST_EXPOSED}", "myograded.service")

    @needs("systemd-analyze")
    def test_the_service_is_hardly_exposed(self):
        done = self.exposure()
        self.assertEqual(done.returncode, 0, done.stdout[-200:] + done.stderr)
        # The examples are read, and what they cost shows.
        for name in ("root.conf", "network.conf"):
            done = self.exposure(name)
            self.assertNotEqual(done.returncode, 0, name)
            self.assertNotIn("Unknown key", done.stderr)
        done = run("systemd-analyze", "security", "--offline=yes", "--no-pager", f"--threshold={MOST_EXPOSED}",
                   UNITS / "myograde-connect@.service")
        self.assertEqual(done.returncode, 0, done.stdout[-200:] + done.stderr)

    @needs("systemd-analyze")
    def test_units_and_examples_have_no_mistake(self):
        for unit in UNITS.glob("*.conf"):
            for line in unit.read_text().splitlines():
                self.assertRegex(line, r"^(#.*|\[Service\]|[A-Z][A-Za-z]+=.*)$")
        done = run("systemd-analyze", "verify", "--man=no", UNITS / "myograded.socket",
                   UNITS / "myograded-https.socket", UNITS / "myograde-connect@.service")
        self.assertNotIn("Unknown", done.stderr)

    def test_the_service_may_open_what_its_own_doctor_asks_for(self):
        unit = (UNITS / "myograded.service").read_text()
        allowed = int(re.search(r"^LimitNOFILE=(\d+)$", unit, re.MULTILINE)[1])
        slots, in_a_message = 8, 253
        for track in ("manipulation", "locomotion", "elbow", "reorientation", "baoding",
                      "relocation", "chasetag"):
            budgets = json.loads((SOURCE / f"configs/tracks/{track}.json").read_text())["budgets"]
            self.assertGreaterEqual(
                allowed, budgets["open_files"] + slots * budgets["tasks"] * in_a_message, track)

    def test_setup_explains_itself_and_refuses_what_it_does_not_know(self):
        told = run("sh", DEBIAN / "myograde-setup", "--help")
        self.assertEqual((told.returncode, told.stderr), (0, ""))
        self.assertIn("Example:", told.stdout)
        self.assertEqual(run("sh", DEBIAN / "myograde-setup", "--fast").returncode, 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
