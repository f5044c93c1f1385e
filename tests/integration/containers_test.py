"""The images of docker/, built by buildah on a Debian made by mmdebstrap, and run by podman as
docker/README.md says: the server grades, keeps its data in a volume, serves TLS, and stops when told."""

import json
import os
import pathlib
import re
import resource
import shutil
import ssl
import subprocess
import tempfile
import time
import unittest
import urllib.request

from support.certificates import make_certificate

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
BASE = "localhost/myograde-test-debian:12"
SERVER, POLICY = "localhost/myograde-test-server", "localhost/myograde-test-policy"
TOOLS = ("buildah", "podman", "mmdebstrap")
BUILD_S, RUN_S, START_S = 2400, 300, 60
POLICIES = "/usr/local/share/myograde/policies"
PAGE = (SOURCE / "docker/README.md").read_text(encoding="utf-8")


def run(*words, seconds=RUN_S, check=True):
    done = subprocess.run([str(word) for word in words], timeout=seconds, capture_output=True, text=True,
                          check=False, cwd=SOURCE, stdin=subprocess.DEVNULL)
    if check and done.returncode != 0:
        raise AssertionError(f"{words}: {done.returncode}\n{(done.stdout + done.stderr)[-3000:]}")
    return done


def options(title):
    """The options of the page's list under this heading."""
    section = PAGE.split(f"### {title}\n")[1].split("\n#")[0]
    return re.findall(r"^\| `(--[^`]*)` \|", section, re.MULTILINE)


def limits():
    """An engine's own limits may be above what it may set."""
    files = min(resource.getrlimit(resource.RLIMIT_NOFILE)[1], 20000)
    return ["--ulimit", f"nofile={files}:{files}", "--ulimit", "nproc=30000:30000"]


@unittest.skipUnless(os.geteuid() == 0, "only root makes a Debian to build on")
@unittest.skipUnless(all(map(shutil.which, TOOLS)), f"one of {', '.join(TOOLS)} is not installed")
class Containers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-containers-"))
        cls.addClassCleanup(shutil.rmtree, cls.root, True)
        made = run("mmdebstrap", "--variant=minbase", "--include=ca-certificates", "bookworm",
                   cls.root / "base.tar", seconds=BUILD_S, check=False)
        if made.returncode != 0:
            raise unittest.SkipTest("no Debian can be made here: " + made.stderr[-300:])
        run("podman", "import", cls.root / "base.tar", BASE)
        cls.addClassCleanup(run, "podman", "rmi", "--force", SERVER, POLICY, BASE, check=False)
        build = ("buildah", "build", "--format", "docker", "--network", "host", "--isolation", "chroot", "--build-arg",
                 f"BASE={BASE}")
        # What ./dev setup has fetched need not be fetched again.
        run(*build, "--volume", f"{CACHE}:/var/cache/myograde", "-f", "docker/server.Dockerfile", "-t",
            SERVER, ".", seconds=BUILD_S)
        run(*build, "--volume", "/etc/ssl/certs:/etc/ssl/certs:ro", "-f", "docker/participant.Dockerfile",
            "-t", POLICY, ".", seconds=BUILD_S)

    def server(self, *words, title="Without root", **more):
        return run("podman", "run", "--rm", *limits(), *options(title), *words, **more)

    def start(self, name, *words):
        """A daemon in the background, once it answers."""
        run("podman", "run", "--detach", "--name", name, *limits(), *options("Without root"), *words, SERVER)
        self.addCleanup(run, "podman", "rm", "--force", name, check=False)
        deadline = time.monotonic() + START_S
        while run("podman", "exec", name, "myograde", "status", check=False).returncode != 0:
            self.assertLess(time.monotonic(), deadline, run("podman", "logs", name).stderr)
            time.sleep(0.5)

    def test_it_grades_in_both_ways_that_the_page_names(self):
        digests = []
        for title in ("Without root", "As root, with the stronger limits"):
            with self.subTest(title=title):
                told = json.loads(self.server(
                    "--network", "none", SERVER, "local", f"{POLICIES}/scripted-elbow", "--track", "elbow",
                    "--episodes", "2", "--json", title=title).stdout)
                self.assertEqual(told["aggregate"]["successes"], 2)
                digests.append(told["merkle_root"])
        self.assertEqual(len(set(digests)), 1)

    def test_without_the_options_it_says_what_is_missing(self):
        done = run("podman", "run", "--rm", *limits(), SERVER, "doctor", check=False)
        self.assertEqual(done.returncode, 4, done.stdout + done.stderr)
        self.assertIn("missing", done.stdout)

    def test_data_outlive_the_container_and_tls_is_served(self):
        certificate, key = make_certificate(self.root)
        tls = self.root / "tls"
        tls.mkdir()
        for file in (certificate, key):
            shutil.copy(file, tls)
            os.chown(tls / file.name, 1000, 1000)
        config = json.loads((SOURCE / "configs/server.json").read_text(encoding="utf-8"))
        config["http"]["listen"] = {"address": "0.0.0.0", "port": 8443,
                                    "certificate": f"/run/tls/{certificate.name}",
                                    "key": f"/run/tls/{key.name}"}
        (self.root / "server.json").write_text(json.dumps(config), encoding="utf-8")
        run("podman", "volume", "create", "myograde-test-data")
        self.addCleanup(run, "podman", "volume", "rm", "--force", "myograde-test-data", check=False)
        words = ("--network", "host", "--volume", "myograde-test-data:/var/lib/myograde", "--volume",
                 f"{tls}:/run/tls:ro", "--volume",
                 f"{self.root}/server.json:/usr/local/share/myograde/configs/server.json:ro")
        name = f"myograde-test-{os.getpid()}"
        self.start(name, *words)
        run("podman", "exec", name, "myograde", "submit", f"{POLICIES}/scripted-elbow", "--track", "elbow",
            "--team", "Blue", "--episodes", "2", "--wait")
        shown = run("podman", "exec", name, "myograde", "show", "1", "--json").stdout
        with urllib.request.urlopen("https://localhost:8443/", timeout=30, context=ssl.create_default_context(
                cafile=str(certificate))) as page:
            self.assertEqual(page.status, 200)
        self.assertEqual(run("podman", "healthcheck", "run", name, check=False).returncode, 0)
        run("podman", "stop", "--time", "60", name)
        self.assertEqual(run("podman", "inspect", "--format", "{{.State.ExitCode}}", name).stdout.strip(), "0")
        run("podman", "rm", name)
        self.start(name, *words)
        again = run("podman", "exec", name, "myograde", "show", "1", "--json").stdout
        self.assertEqual(json.loads(again)["merkle_root"], json.loads(shown)["merkle_root"])

    def test_a_participant_s_image_has_the_kit(self):
        done = run("podman", "run", "--rm", *limits(), "--network", "none", POLICY, "python3", "-c",
                   "import lcm, myograde, numpy; print(myograde.Policy.__name__)")
        self.assertEqual(done.stdout.strip(), "Policy")


if __name__ == "__main__":
    unittest.main(verbosity=2)
