"""Agents of 2022 to 2024 as container images, as they were sent then: the agent's files at the image's
root, its packages in the image's own Python, a relative command and no working folder."""

import os
import pathlib
import re
import shutil
import subprocess
import unittest

import template_agents_test
from support import images
from system import REFERENCES, SystemTest, track_config

AGENTS, RUNTIME = template_agents_test.AGENTS, template_agents_test.RUNTIME
PYTHON = pathlib.Path("/usr/lib/python3.11")
# No part of what an agent imports, and a third of the size.
NOT_NEEDED = shutil.ignore_patterns("test", "tests", "__pycache__", "idlelib", "tkinter",
                                    "turtledemo", "ensurepip", "include", "lcm*", "distutils")


def tree(folder, place):
    """The members of a layer that puts the files of `folder` at `place`."""
    members = []
    for root, names, files in os.walk(folder):
        names[:] = sorted(set(names) - NOT_NEEDED(root, names))
        for name in sorted(set(files) - NOT_NEEDED(root, files)):
            file = pathlib.Path(root, name)
            if file.is_file():
                members.append(images.member(f"{place}/{file.relative_to(folder)}",
                                             file.read_bytes(), mode=file.stat().st_mode & 0o755))
    return members


def libraries(*folders):
    """The host's libraries that those below the folders load."""
    files = [str(file) for folder in folders for file in pathlib.Path(folder).rglob("*.so*")]
    told = subprocess.run(["ldd", *files], capture_output=True, text=True, check=False).stdout
    return sorted(set(re.findall(r"=> (/lib/\S+)", told)))


def python_layers():
    """Python as an agent's image has it, and the packages beside it."""
    base = images.program_layer("/usr/bin/python3.11", "usr/bin/python3.11",
                                libraries(PYTHON / "lib-dynload", RUNTIME / "grpc",
                                          RUNTIME / "numpy"))
    base += [images.link("bin", "usr/bin"), images.link("usr/bin/python3", "python3.11"),
             images.link("usr/bin/python", "python3.11"), *tree(PYTHON, "usr/lib/python3.11")]
    return base, tree(RUNTIME, "usr/local/lib/python3.11/dist-packages")


@unittest.skipUnless((RUNTIME / "grpc").is_dir(), f"there is no runtime {RUNTIME}")
@unittest.skipUnless(PYTHON.is_dir(), f"there is no {PYTHON} to make an image of")
class TemplateImages(SystemTest):
    references = (*REFERENCES, "reorientation", "relocation")
    tracks = {"short-arm": track_config("manipulation"), "short-leg": track_config("locomotion"),
              "short-die": track_config("reorientation"), "short-bin": track_config("relocation")}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.daemon.configure(runtimes={"template-2024": {"path": str(RUNTIME)}})
        cls.layers = python_layers()

    def image(self, name, *files, arguments=(), form="docker", adapter="template-2024"):
        """A submission folder that names the image."""
        agent = [images.member(file.name, file.read_bytes())
                 for file in [*sorted((AGENTS / "template").iterdir()), AGENTS / f"{name}.py",
                              *(AGENTS / file for file in files)] if file.is_file()]
        folder = self.root / f"image-{name}-{form}"
        folder.mkdir()
        (folder / "agent.tar").write_bytes(images.image(
            [*self.layers, agent], form=form, entrypoint=None, cmd=["python", f"{name}.py", *arguments],
            env=["PATH=/usr/local/bin:/usr/bin:/bin", "PYTHONUNBUFFERED=1",
                 "LD_LIBRARY_PATH=/nowhere"]))
        (folder / "policy.json").write_text(
            f'{{"name": "{name}", "image": "agent.tar", "adapter": "{adapter}"}}')
        return folder

    def digests(self, policy, track, profile="myosuite"):
        result = self.ask("local", policy, "--track", track, "--profile", profile)
        for row in result["episodes"]:
            self.assertIn(row["outcome"], ("success", "failure"), row)
        return [row["digest"] for row in result["episodes"]]

    def as_folder(self, name, *arguments, files=(), **manifest):
        return template_agents_test.TemplateAgents.agent(self, name, *arguments, files=files,
                                                         **manifest)

    def test_an_image_plays_as_its_folder_does(self):
        for form in ("docker", "oci-gzip"):
            with self.subTest(form=form):
                self.assertEqual(
                    self.digests(self.image("fingers_agent", "hand.json", form=form), "short-arm"),
                    self.digests(self.as_folder("fingers_agent", files=["hand.json"]), "short-arm"))

    def test_so_do_those_of_earlier_years(self):
        for year, track, arguments in (
                ("2022", "short-die", ("8085", "hand_qpos", "22")),
                ("2023", "short-bin", template_agents_test.RELOCATION_2023)):
            with self.subTest(year=year):
                name, adapter = f"agent_{year}", f"template-{year}"
                self.assertEqual(
                    self.digests(self.image(name, arguments=arguments, adapter=adapter),
                                 track, "official"),
                    self.digests(self.as_folder(name, *arguments, adapter=adapter),
                                 track, "official"))

    def test_its_unseeded_samples_repeat(self):
        agent = self.image("image_leg_agent", "locomotion_sets.py")
        first = self.digests(agent, "short-leg")
        self.assertEqual(first, self.digests(agent, "short-leg"))
        self.assertEqual(len(set(first)), 3)


if __name__ == "__main__":
    unittest.main(verbosity=2)
