"""Commands of all pages: each page that has some is typed by a test or says in commands.json why not, and
each verb and option of the command line tool that any page names is one that it has."""

import json
import os
import pathlib
import re
import shlex
import subprocess
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CLI = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]) / "myograde"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# How a plain fence with commands begins; others are output, formats or drawings.
COMMAND = re.compile(r"(\$ |sudo |\./|build/|tests/|myograde(-\w+)? |openssl |curl |podman |pip |cmake |docker )")
CALL = re.compile(r"(?:^|(?<!-m)[\s;(|&])(?:\S*/)?myograde ((?:[^|;&<>#\\\n]|\\\n)*)", re.MULTILINE)


def fences():
    """(page, text) of each fence with commands."""
    for path in sorted(SOURCE.rglob("*.md")):
        page = path.relative_to(SOURCE)
        if "build" in page.parts:
            continue
        for language, body in FENCE.findall(path.read_text(encoding="utf-8")):
            if language == "sh" or (language == "" and COMMAND.match(body.lstrip())):
                yield page.as_posix(), body


def calls(text):
    """The words of each call of the command line tool."""
    for match in CALL.finditer(text):
        words = match[1].replace("\\\n", " ")
        try:
            yield shlex.split(words)
        except ValueError:  # a quotation that goes on behind a character that ends a call
            yield words.split()


class Commands(unittest.TestCase):
    helps = {}

    def help_of(self, *verbs):
        if verbs not in self.helps:
            done = subprocess.run([CLI, *verbs, "--help"], capture_output=True, text=True, timeout=60,
                                  check=False)
            self.helps[verbs] = done.stdout if done.returncode == 0 else None
        return self.helps[verbs]

    def test_each_page_with_commands_is_typed_by_a_test_or_says_why_not(self):
        listed = json.loads((SOURCE / "tests/integration/commands.json").read_text())
        found = {page for page, _ in fences()}
        self.assertEqual(sorted(found), sorted(listed))
        self.assertGreater(len(found), 15)
        for page, entry in listed.items():
            self.assertTrue(entry and set(entry) <= {"typed_by", "not_typed"}, page)
            if "typed_by" in entry:
                test = SOURCE / entry["typed_by"]
                self.assertTrue(test.is_file(), f"{page}: {test}")
            for named in re.findall(r"tests/[\w/.]+\w", entry.get("not_typed", "")):
                self.assertTrue((SOURCE / named).exists(), f"{page}: {named}")

    def test_each_verb_and_option_is_one_that_the_tool_has(self):
        count = 0
        for page, text in fences():
            for words in calls(text):
                if not words or words[0].startswith("-"):
                    continue
                with self.subTest(page=page, words=words):
                    verbs = [words[0]]
                    self.assertIsNotNone(self.help_of(*verbs), "no such verb")
                    for word in words[1:3]:
                        if not (re.fullmatch(r"[a-z][a-z-]*", word) and re.search(
                                rf"^  {word}\b", self.help_of(*verbs), re.MULTILINE)):
                            break
                        verbs.append(word)
                    text_of_help = self.help_of(*verbs)
                    for option in words:
                        if re.match(r"--[a-z]", option):
                            name = option.split("=")[0]
                            self.assertRegex(text_of_help, rf"(?<![\w-]){name}(?![\w-])")
                            count += 1
        self.assertGreater(count, 60)

    def test_the_section_on_signed_releases_can_be_typed(self):
        page = (SOURCE / "docker/README.md").read_text(encoding="utf-8")
        _, sign, check = (body for _, body in FENCE.findall(page.split("\n## Signed releases\n")[1]))
        with tempfile.TemporaryDirectory() as folder:
            release = pathlib.Path(folder, "myograde-1.0.0")
            (release / "third-party").mkdir(parents=True)
            (release / "myograde-server_1.0.0_amd64.deb").write_text("a package")
            (release / "third-party/NOTICE.txt").write_text("licences")

            def type_in(script):
                path = f"{CLI.parent}:{os.environ['PATH']}"
                return subprocess.run(["bash", "-e", "-o", "pipefail", "-c", script], cwd=folder, capture_output=True,
                                      text=True, timeout=120, env={**os.environ, "PATH": path})

            for script in (sign, check):
                done = type_in(script)
                self.assertEqual(done.returncode, 0, f"{script}\n{done.stdout}{done.stderr}")
            (release / "myograde-server_1.0.0_amd64.deb").write_text("another package")
            ours, *others = check.splitlines()
            self.assertEqual(type_in(ours).returncode, 1)
            self.assertNotEqual(type_in("\n".join(others)).returncode, 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
