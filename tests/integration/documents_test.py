"""Tries everything in the documents' fences: manifests, policies, commands. Whatever is copied
from a page works as it is."""

import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess

from system import POLICIES, SOURCE, SystemTest, track_config

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
STILL = {"name": "documented", "command": ["python3", "policy.py"], "runtimes": ["python"]}


def pages():
    for path in sorted(SOURCE.rglob("*.md")):
        if "build" not in path.relative_to(SOURCE).parts:
            yield path.relative_to(SOURCE).as_posix(), path.read_text(encoding="utf-8")


def blocks(text, *languages):
    return [body for language, body in FENCE.findall(text) if language in languages]


class Documents(SystemTest):
    tracks = {"short-arm": track_config("manipulation"), "short-leg": track_config("locomotion")}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # Like a clone after ./dev build, with a shortened full track of the documents.
        cls.work = cls.root / "clone"
        (cls.work / "build").mkdir(parents=True)
        (cls.work / "build/release").symlink_to(POLICIES.parent)
        cls.daemon.change_config("tracks/locomotion.json", seeds={"first": 7000, "count": 10})

    def bash(self, script, **variables):
        result = subprocess.run(["bash", "-e", "-c", script], cwd=self.work, capture_output=True,
                                text=True, timeout=600, stdin=subprocess.DEVNULL,
                                env={**self.environment, **variables})
        self.assertEqual(result.returncode, 0, f"{script}\n{result.stdout}{result.stderr}")
        return result.stdout

    def play(self, folder, track="short-leg", *arguments):
        """Plays an episode without a fault."""
        result = self.ask("local", folder, "--track", track, "--episodes", "1", *arguments)
        for row in result["episodes"]:
            self.assertIn(row["outcome"], ("success", "failure"), row)
        return result

    def fenced_policy(self, name, source, manifest=None):
        folder = self.python_policy(name, ["policy.py"])
        (folder / "policy.py").write_text(source)
        (folder / "policy.json").write_text(json.dumps(manifest or STILL))
        return folder

    def test_no_fence_is_of_a_kind_that_nobody_tries(self):
        for page, text in pages():
            self.assertEqual(text.count("\n```") + text.startswith("```"),
                             2 * len(FENCE.findall(text)),
                             f"{page}: a fence without an end")
            for language, body in FENCE.findall(text):
                self.assertIn(language, ("", "cpp", "json", "python", "sh"), page)
                if language == "json":
                    json.loads(body)

    def test_every_policy_in_python_plays(self):
        count = 0
        for page, text in pages():
            for source in blocks(text, "python"):
                # Scripts that train are run by tests/policies/environments_test.py.
                if re.search(r"myograde\.(envs|vec)\b", source):
                    continue
                count += 1
                with self.subTest(page=page):
                    self.play(self.fenced_policy(f"documented-{count}", source))
        self.assertGreaterEqual(count, 3)

    def test_every_manifest_is_taken(self):
        count = 0
        for page, text in pages():
            for body in blocks(text, "json"):
                manifest = json.loads(body)
                # An upload's answer also contains "command".
                if "command" not in manifest or "artefact" in manifest:
                    continue
                count += 1
                with self.subTest(page=page, manifest=manifest):
                    folder = self.fenced_policy(f"manifest-{count}", "raise SystemExit(3)",
                                                manifest)
                    for word in manifest["command"]:
                        if word.startswith("./"):
                            (folder / word).write_text("#!/bin/sh\nexit 3\n")
                            (folder / word).chmod(0o755)
                    # It starts to play, and its program then does nothing: 1, not 2.
                    said = self.run_cli("local", folder, "--track", "short-leg", "--episodes", "1",
                                        check=False)
                    self.assertEqual(said.returncode, 1, said.stdout + said.stderr)
        self.assertGreaterEqual(count, 4)

    def section(self, title):
        """The fences below a heading, up to the next one."""
        text = (SOURCE / "policies/README.md").read_text(encoding="utf-8")
        begin = re.search(f"^#+ {title}\n", text, re.MULTILINE).end()
        end = re.compile("^#+ ", re.MULTILINE).search(text, begin).start()
        return FENCE.findall(text[begin:end])

    def follow(self, title, before_last, **variables):
        """Executes a section's steps in order; the folder is the one that it creates."""
        folder = None
        steps = self.section(title)
        for number, (language, body) in enumerate(steps):
            if number == len(steps) - 1:
                before_last(folder)
            if language == "sh":
                self.bash(body, **variables)
                if body.startswith(("cp -r ", "mkdir ")):
                    folder = self.work / body.split()[-1]
            else:
                name = {"python": "policy.py", "json": "policy.json"}[language]
                (folder / name).write_text(body)
        return folder

    def test_the_section_on_a_first_policy_is_followed_to_the_letter(self):
        for _, body in self.section("A first policy"):
            self.bash(body)
        self.play(self.work / "my_policy")

    def test_the_sections_on_python_are_followed_to_the_letter(self):
        # pip finds here what it would get from PyPI.
        tools = SOURCE / "docker/wheel-tools.txt"
        digest = hashlib.sha256(tools.read_bytes()).hexdigest()[:12]
        environment = pathlib.Path(os.environ["MYOGRADE_CACHE"]) / f"wheel-tools-{digest}"
        made = subprocess.run([SOURCE / "docker/make_venv.sh", environment, tools],
                              capture_output=True, text=True, timeout=600)
        if made.returncode != 0:
            self.skipTest(f"no package can be built here: {made.stdout}{made.stderr}")
        found = next(environment.glob("lib/python3*/site-packages"))
        for name in ("policies", "protocol", "docker"):
            shutil.copytree(SOURCE / name, self.work / name, dirs_exist_ok=True)
        shutil.copy(SOURCE / "LICENSE", self.work)
        # The environments, which take minutes to build, are system_guide_install's to install.
        folder = self.follow("In Python", lambda _: None, PYTHONPATH=str(found), PIP_NO_INDEX="1",
                             MYOGRADE_PURE="1", PIP_NO_BUILD_ISOLATION="0")  # as pip reads it: none
        self.assertEqual(folder, self.work / "still")
        (_, client), = self.section("Results")
        # In a data folder of its own, as the tour begins with submission 1.
        usual, self.daemon.data = self.daemon.data, self.root / "participants"
        try:
            self.daemon.start()
            said = self.bash(client)
        finally:
            self.daemon.stop()
            self.daemon.data = usual
        self.assertRegex(said, r"done 2 of 2\n0 (success|failure) [\d.]+\n1 (success|failure) "
                         r"[\d.]+\n$")

    def test_what_a_policy_still_holds_at_its_end_is_kept_and_its_variables_are_set(self):
        still = next(body for language, body in self.section("In Python") if language == "python")
        # Without PYTHONUNBUFFERED the interpreter buffers its output until a normal exit.
        policy = self.fenced_policy("last-words", "import atexit, os\n"
                                    "atexit.register(print, 'goodbye', os.environ['POLICY_WHO'])\n"
                                    "print('hello')\n" + still,
                                    {**STILL, "env": {"PYTHONUNBUFFERED": "",
                                                      "POLICY_WHO": "judge"}})
        output = self.play(policy)["output"]
        self.assertEqual([lease["stdout_tail"] for lease in output], ["hello\ngoodbye judge\n"])

    def test_a_program_that_is_not_there_is_refused_with_the_reason(self):
        for program, reason in (("python4", "nor a program of the sandbox"),
                                ("venv/bin/python3", "/usr/local/bin/python3.99")):
            folder = self.fenced_policy(f"lost-{program[:4]}", "", {**STILL, "command": [program]})
            (folder / "venv/bin").mkdir(parents=True)
            (folder / "venv/bin/python3").symlink_to("/usr/local/bin/python3.99")
            said = self.run_cli("local", folder, "--track", "short-leg", check=False)
            self.assertEqual(said.returncode, 2, said.stdout + said.stderr)
            self.assertIn(reason, said.stderr)

    def test_a_virtual_environment_of_the_hosts_python_plays(self):
        still = next(body for language, body in self.section("In Python") if language == "python")
        policy = self.fenced_policy("own-packages", "import own\n" + still,
                                    {**STILL, "command": ["venv/bin/python3", "policy.py"]})
        made = subprocess.run(["/usr/bin/python3", "-m", "venv", "--without-pip", policy / "venv"],
                              capture_output=True, text=True, timeout=120)
        if made.returncode != 0:
            self.skipTest(f"no virtual environments here: {made.stderr}")
        packages = next((policy / "venv/lib").glob("python3*/site-packages"))
        (packages / "own.py").write_text("print('mine')\n")
        output = self.play(policy)["output"]
        self.assertEqual(output[0]["stdout_tail"], "mine\n")

    def test_a_compiled_module_is_used_as_it_is(self):
        still = next(body for language, body in self.section("In Python") if language == "python")
        policy = self.fenced_policy("compiled", "import big\nprint(hasattr(big, 'kept'))\n" + still)
        (policy / "big.py").write_text("seen = 1\n")
        subprocess.run(["/usr/bin/python3", "-m", "compileall", "-q", policy / "big.py"],
                       check=True)
        # The compiled file has another name in it; if the source's time differed Python would
        # ignore it.
        cached = next((policy / "__pycache__").glob("big.*.pyc"))
        cached.write_bytes(cached.read_bytes().replace(b"seen", b"kept"))
        self.assertEqual(self.play(policy)["output"][0]["stdout_tail"], "True\n")

    def test_the_section_on_agents_of_2024_is_followed_to_the_letter(self):
        agents = SOURCE / "tests/integration/template_agents"
        (body,) = [body for language, body in self.section("With an agent of 2022, 2023 or 2024")
                   if language == "json"]
        folder = self.work / "veteran"
        shutil.copytree(agents / "template", folder)
        shutil.copy(agents / "manipulation_agent.py", folder / json.loads(body)["command"][1])
        (folder / "policy.json").write_text(body)
        self.play(folder, "short-arm", "--profile", "myosuite")

    def test_the_tour_of_the_command_line_can_be_typed(self):
        text = (SOURCE / "README.md").read_text(encoding="utf-8")
        begin = text.index("## Try a policy\n")
        self.assertIn("Open try1/", self.bash(blocks(text[begin:], "")[0].replace("PATH", str(POLICIES / "zero"))))
        begin = text.index("## Grade a policy\n")
        script = blocks(text[begin:], "")[0]
        values = {"PATH": POLICIES / "zero", "DIR": self.data, "NAME": "alpha"}
        script = re.sub(r"\b(PATH|DIR|NAME)\b", lambda word: str(values[word[0]]), script)
        lines = [line.split("#")[0].strip() for line in script.splitlines()]
        self.assertIn(" serve ", lines[0])
        self.assertTrue(lines[0].endswith("&"), lines[0])
        type(self).start_daemon()
        try:
            for line in filter(None, lines[1:]):
                with self.subTest(line=line):
                    self.bash(line)
        finally:
            self.stop_daemon()
        self.assertTrue((self.work / "receipt.json").exists())

    def test_the_verbs_of_dev_are_its_own(self):
        known = subprocess.run([SOURCE / "dev", "help"], capture_output=True, text=True, check=True)
        for page, text in pages():
            for body in blocks(text, "", "sh"):
                for verb in re.findall(r"\./dev (\w+)", body):
                    self.assertRegex(known.stdout, rf"\n  {verb}\b", page)
