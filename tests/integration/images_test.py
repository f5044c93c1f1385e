"""Container images as submissions: played through a daemon and by local, and refused if they are
hostile. Images are made by hand; with buildah and podman, really built and saved ones too."""

import gzip
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

from support import images
from system import POLICIES, SystemTest, track_config

CHECKS = """#!/bin/sh
# Says what it sees; the policy follows.
echo "user $(id -u):$(id -g) in $PWD, $MINE, home $HOME"
for path in /policy/policy.json /etc/resolv.conf /proc/1/environ /myograde/evil; do
  [ -r "$path" ] && echo "sees $path"
done
touch /written 2>/dev/null && echo "writes to its root"
touch /tmp/mine && echo "writes to /tmp"
grep -q environment /etc/hosts && echo "knows environment"
exec /app/policy
"""
SHELL = ("/bin/sh", "/usr/bin/id", "/usr/bin/touch", "/usr/bin/grep")


def shell_layer():
    """A layer with a shell and a few programs of this host."""
    members = {}
    for program in SHELL:
        for info, content in images.program_layer(program, name=program.lstrip("/")):
            members.setdefault(info.name, (info, content))
    return [pair for name, pair in members.items() if not name.startswith("bin/")] + [
        images.folder("bin"), *(pair for name, pair in members.items() if name.startswith("bin/"))]


class Images(SystemTest):
    tracks = {"short-leg": track_config("locomotion")}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_daemon()

    def write(self, name, content):
        path = self.folder / name
        path.write_bytes(content)
        return path

    def setUp(self):
        super().setUp()
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-images-"))
        self.addCleanup(shutil.rmtree, self.folder, True)

    def digests(self, result):
        return [row["digest"] for row in result["episodes"]]

    def test_an_image_plays_as_its_program_does(self):
        zero = self.ask("local", POLICIES / "zero", "--track", "short-leg")
        layers = [images.program_layer(POLICIES / "zero/zero"), shell_layer(),
                  [images.folder("app"), images.member("app/start", CHECKS.encode(), mode=0o755),
                   images.link("app/policy", "../../../policy"),
                   images.member("proc/evil", b"x"), images.member("myograde/evil", b"x"),
                   images.member("etc/passwd", b"app:x:4321:99::/app:/bin/sh\n")]]
        about = {"entrypoint": ("./start",), "user": "app", "workdir": "/app",
                 "env": ("PATH=/usr/bin:/bin", "MINE=yes", "HOME=/root",
                         "LD_PRELOAD_OF_THE_GRADER=no")}
        for form in ("docker", "oci-gzip"):
            archive = self.write(f"{form}.tar", images.image(layers, form=form, **about))
            result = self.ask("local", archive, "--track", "short-leg")
            self.assertEqual(result["name"], "agent")
            self.assertEqual(self.digests(result), self.digests(zero))
            said = json.dumps(result["output"])
            self.assertIn("user 4321:99 in /app, yes, home /tmp", said)
            self.assertIn("writes to /tmp", said)
            self.assertIn("knows environment", said)
            for wrong in ("sees /", "writes to its root"):
                self.assertNotIn(wrong, said)

    def test_the_images_libraries_and_variables_stay_out_of_the_graders_programs(self):
        evil = b"not a library"
        layers = [images.program_layer(POLICIES / "zero/zero"),
                  [images.member("etc/ld.so.cache", evil), images.member("usr/lib/evil.so", evil),
                   images.member("usr/bin/prlimit", b"#!/bin/false\n", mode=0o755)]]
        # The policy's own loader complains of LD_PRELOAD and goes on.
        archive = self.write("image.tar", images.image(
            layers, env=("LD_PRELOAD=/usr/lib/evil.so", "OPENSSL_CONF=/usr/lib/evil.so",
                         "GLIBC_TUNABLES=glibc.malloc.check=3")))
        result = self.ask("local", archive, "--track", "short-leg")
        self.assertEqual([row["outcome"] for row in result["episodes"]],
                         ["failure"] * len(result["episodes"]))

    def test_the_daemon_takes_images_and_keeps_their_layers_once(self):
        base = images.program_layer(POLICIES / "zero/zero")
        for number in (1, 2):
            layers = [base, [images.member("number", str(number).encode())]]
            archive = self.write(f"image{number}.tar", images.image(layers, form="oci-gzip"))
            done = self.ask("submit", archive, "--track", "short-leg", "--team", f"Team {number}",
                            "--wait")
            self.assertEqual(done["state"], "done", done)
        artefacts = list((self.data / "artefacts").iterdir())
        self.assertEqual(len(artefacts), 2)
        programs = [os.stat(one / "image/policy") for one in artefacts]
        self.assertEqual(len({info.st_ino for info in programs}), 1)
        self.assertEqual(programs[0].st_nlink, 3)


@unittest.skipUnless(images.has_engine(), "buildah and podman are not installed")
class BuiltImages(SystemTest):
    """Built from scratch by buildah, without a registry, and saved in each form."""
    tracks = {"short-leg": track_config("locomotion")}

    def run_engine(self, *words, **more):
        return subprocess.run([str(word) for word in words], check=True, timeout=300,
                              stdout=subprocess.PIPE, text=True, **more).stdout.strip()

    def setUp(self):
        super().setUp()
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-images-"))
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.storage = ["--root", self.folder / "storage", "--runroot", self.folder / "run",
                        "--storage-driver", "vfs"]

    def build(self):
        root = self.folder / "tree"
        for info, content in images.program_layer(POLICIES / "zero/zero"):
            path = root / info.name
            path.parent.mkdir(parents=True, exist_ok=True)
            if info.isdir():
                path.mkdir(exist_ok=True)
            elif info.issym():
                path.symlink_to(info.linkname)
            else:
                path.write_bytes(content)
                path.chmod(info.mode)
        buildah = ["buildah", *self.storage]
        container = self.run_engine(*buildah, "from", "scratch")
        self.run_engine(*buildah, "add", container, root, "/")
        self.run_engine(*buildah, "config", "--entrypoint", '["/policy"]', "--user", "1234",
                        "--workingdir", "/app", container)
        self.run_engine(*buildah, "commit", container, "agent:latest")
        return buildah

    def test_every_form_is_the_same_submission(self):
        buildah = self.build()
        podman = ["podman", *self.storage]
        files = {name: self.folder / f"{name}.tar" for name in ("oci", "docker", "podman", "saved")}
        self.run_engine(*buildah, "push", "agent:latest", f"oci-archive:{files['oci']}:agent")
        self.run_engine(*buildah, "push", "agent:latest",
                        f"docker-archive:{files['docker']}:agent:latest")
        self.run_engine(*podman, "save", "-o", files["podman"], "agent:latest")
        self.run_engine(*podman, "save", "--format", "oci-archive", "-o", files["saved"],
                        "agent:latest")
        files["gzip"] = self.folder / "agent.tar.gz"  # names the policy, as its tag is not read
        with gzip.open(files["gzip"], "wb") as packed:
            packed.write(files["podman"].read_bytes())
        zero = self.ask("local", POLICIES / "zero", "--track", "short-leg")
        expected = [row["digest"] for row in zero["episodes"]]
        artefacts = {}
        for name, path in files.items():
            with self.subTest(form=name):
                result = self.ask("local", path, "--track", "short-leg")
                self.assertEqual([row["digest"] for row in result["episodes"]], expected)
                artefacts[name] = result["hashes"]["artefact"]
        self.assertEqual(len(set(artefacts.values())), 1,
                         f"one image in several forms is one artefact: {artefacts}")


if __name__ == "__main__":
    unittest.main(verbosity=2)
