"""The verb new: the folder that it writes, what it refuses, and that it leaves nothing half made.
usage: new_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import pathlib
import stat
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import BIN_DIR, CliCase, myograde  # pylint: disable=wrong-import-position

OWN_FILES = {"cpp": {"CMakeLists.txt", "README.md", "build.sh", "policy.cc", "policy.json"},
             "python": {"README.md", "policy.json", "policy.py"},
             "torch": {"README.md", "train.py", "submission/policy.json", "submission/policy.py",
                       "submission/network.py"}}


class NewTest(CliCase):
    def tearDown(self):
        self.assertEqual([str(path) for path in pathlib.Path(self.temp).rglob("*.part*")], [])

    def made(self, name, lang, *words):
        told = self.checked("new", "new", name, "--lang", lang, "--output", self.path(name), *words)
        return pathlib.Path(told["folder"]), told

    def test_each_language_has_a_whole_starter(self):
        for lang, own in OWN_FILES.items():
            folder, told = self.made(f"my-{lang}", lang, "--track", "locomotion")
            there = {path.relative_to(folder).as_posix() for path in folder.rglob("*")
                     if path.is_file()}
            place = folder / "submission" if lang == "torch" else folder
            self.assertEqual(sorted(there), told["files"])
            self.assertLessEqual(own, there)
            if lang == "cpp":
                self.assertEqual(own, there)
            else:  # the kit lies beside the program
                self.assertTrue((place / "myograde/policy/kit.py").is_file())
            for name in own:
                self.assertNotRegex((folder / name).read_text(), "@[A-Z]+@", name)
            manifest = json.loads((place / "policy.json").read_text())
            self.assertEqual(manifest["name"], f"my-{lang}")
            page = (folder / "README.md").read_text()
            self.assertTrue(page.startswith(f"# my-{lang}\n"), page)
            self.assertIn("```sh\n" + "\n".join(told["commands"]) + "\n```", page)
            self.assertEqual(len(told["commands"]), 3)
            self.assertIn("--track locomotion", told["commands"][-1])

    def test_only_scripts_can_be_executed_and_the_mask_holds(self):
        folder = pathlib.Path(self.path("masked"))
        subprocess.run(["sh", "-c", 'umask 027; exec "$@"', "sh", f"{BIN_DIR}/myograde", "new",
                        "masked", "--lang", "cpp", "-o", folder], check=True, timeout=60,
                       stdout=subprocess.DEVNULL)
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) & 0o777
                 for path in [folder, *folder.iterdir()]}
        self.assertEqual(modes["masked"], 0o750)
        self.assertEqual(modes["policy.cc"], 0o640)
        self.assertEqual(modes["build.sh"] & 0o700, 0o700)

    def test_the_folder_is_named_as_the_policy_and_a_person_reads_what_to_type(self):
        done = subprocess.run([f"{BIN_DIR}/myograde", "new", "walker", "--lang", "python"],
                              cwd=self.temp, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("\n  cd walker\n  myograde spec ", done.stdout)
        self.assertTrue(os.path.isfile(self.path("walker/policy.py")))

    def test_what_is_there_stays(self):
        os.mkdir(self.path("empty"))
        os.symlink("nowhere", self.path("dangling"))
        self.path("file", "mine")
        for name in ("empty", "dangling", "file"):
            for place in (name, f"{name}/"):
                self.refused(2, "already exists", "new", "walker", "--lang", "cpp",
                             "--output", self.path(place))
        self.assertEqual(sorted(os.listdir(self.temp)), ["dangling", "empty", "file"])
        self.assertEqual(os.listdir(self.path("empty")), [])
        self.assertEqual(pathlib.Path(self.path("file")).read_text(), "mine")

    def test_places_that_can_not_be(self):
        self.path("file", "")
        for place in ("no/where", "file/walker"):
            self.refused(2, "can't be created", "new", "walker", "--lang", "cpp",
                         "-o", self.path(place))

    def test_names_that_would_break_a_program_or_leave_the_folder(self):
        for name in ("", ".", "..", "../x", "a/b", ".hidden", "-x", 'a"b', "a b", "a\nb", "ü",
                     "x" * 65):
            self.refused(2, "use a name of 1", "new", "--lang", "cpp", f"--output={self.path('x')}",
                         "--", name)
        self.assertEqual(os.listdir(self.temp), [])
        self.made("x" * 64, "cpp")

    def test_unknown_languages_and_tracks(self):
        place = ("-o", self.path("x"))
        self.refused(2, "cobol", "new", "walker", "--lang", "cobol", *place)
        self.refused(2, "--lang", "new", "walker", *place)
        self.refused(2, 'no track "running"; known: ', "new", "walker", "--lang", "cpp",
                     "--track", "running", *place)
        self.assertEqual(os.listdir(self.temp), [])

    def test_an_installation_without_starters_is_told(self):
        self.refused(4, "install MyoGrade again", "new", "walker", "--lang", "cpp", "-o",
                     self.path("x"), MYOGRADE_BIN_DIR=self.temp)

    def test_a_full_disk_leaves_nothing(self):
        # The shell's limit on the size of files stands in for the disk.
        done = subprocess.run(["sh", "-c", 'ulimit -f 1; trap "" XFSZ; exec "$@"', "sh",
                               f"{BIN_DIR}/myograde", "new", "walker", "--lang", "cpp", "-o",
                               self.path("x")], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("can't be written", done.stderr)
        self.assertEqual(os.listdir(self.temp), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
