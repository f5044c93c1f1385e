"""What the Debian packages hold beside programs: manual pages, completions and units, checked by the
tools that read them, where they are installed."""

import gzip
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
DEBIAN = SOURCE / "docker/debian"
# In tenths, as systemd-analyze takes it: what the sandboxes need (namespaces, mounts, control groups, root)
# makes up most of it.
MOST_EXPOSED = 56


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
        told = run(BIN / "myograde", "--help").stdout.split("Subcommands:")[1].split("\n\n")[0]
        cls.verbs = [line.split()[0] for line in told.splitlines() if line.startswith("  ") and line[2] != " "]

    def pages(self):
        return sorted(self.folder.glob("man*/*.gz"))

    def test_every_verb_program_and_file_has_a_page(self):
        names = {page.name for page in self.pages()}
        wanted = {f"myograde-{verb}.1.gz" for verb in self.verbs}
        self.assertGreater(len(wanted), 30)
        self.assertEqual(names, wanted | {"myograde.1.gz", "myograded.8.gz", "myograde-setup.8.gz",
                                          "myograde-server.json.5.gz"})

    def test_pages_tell_options_and_their_day(self):
        text = gzip.decompress((self.folder / "man1/myograde-submit.1.gz").read_bytes()).decode()
        for words in (r"\-\-track", "2023-11-14", ".SH EXAMPLE", ".SH EXIT STATUS"):
            self.assertIn(words, text)
        config = gzip.decompress((self.folder / "man5/myograde-server.json.5.gz").read_bytes()).decode()
        self.assertIn("scheduler.max_replays", config)

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
        self.assertEqual(complete("myograde", "sub"), ["submit"])
        self.assertEqual(complete("myograde", ""), [*self.verbs, "--help", "--version"])
        self.assertEqual(complete("myograde", "submit", "--tr"), ["--track"])
        self.assertEqual(complete("myograde", "team", "cr"), ["create"])
        self.assertEqual(complete("myograde", "team", "create", "--rea"), ["--reason"])

    @needs("fish")
    def test_fish_completes(self):
        def complete(line):
            done = run("fish", "--no-config", "-c",
                       f"source {self.folder}/completion/fish; complete -C '{line}'",
                       env={**os.environ, "HOME": str(self.folder)})
            return [entry.split("\t")[0] for entry in done.stdout.splitlines()]
        self.assertEqual(complete("myograde subm"), ["submit"])
        self.assertEqual(complete("myograde submit --tra"), ["--track"])
        self.assertEqual(complete("myograde team cre"), ["create"])

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

    def test_conffiles_are_the_configs(self):
        listed = (self.folder / "control/server/conffiles").read_text().split()
        self.assertEqual(listed, ["/etc/logrotate.d/myograde", "/etc/myograde/sandbox/policy.json",
                                  "/etc/myograde/sandbox/sim.json", "/etc/myograde/server.json"])

    @needs("systemd-analyze")
    def test_the_service_is_no_more_exposed_than_it_must_be(self):
        done = run("systemd-analyze", "security", "--offline=yes", "--no-pager",
                   f"--threshold={MOST_EXPOSED}", DEBIAN / "myograded.service")
        self.assertEqual(done.returncode, 0, done.stdout[-200:] + done.stderr)

    def test_setup_explains_itself_and_refuses_what_it_does_not_know(self):
        told = run("sh", DEBIAN / "myograde-setup", "--help")
        self.assertEqual((told.returncode, told.stderr), (0, ""))
        self.assertIn("Example:", told.stdout)
        self.assertEqual(run("sh", DEBIAN / "myograde-setup", "--fast").returncode, 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
