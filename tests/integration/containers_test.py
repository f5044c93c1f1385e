"""The images of docker/, built by buildah on a Debian made by mmdebstrap, and run by podman as
docker/README.md says: the server grades without and as root, and by podman-compose with TLS and its data in a
volume, and a participant's image has the kit."""

import json
import os
import pathlib
import re
import resource
import shutil
import socket
import ssl
import subprocess
import tempfile
import time
import unittest
import urllib.error
import urllib.request

from support.certificates import make_certificate

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
BASE = "localhost/myograde-test-debian:12"
SERVER, POLICY = "localhost/myograde-test-server", "localhost/myograde-test-policy"
TOOLS = ("buildah", "podman", "mmdebstrap")
FILES, PROCESSES = min(resource.getrlimit(resource.RLIMIT_NOFILE)[1], 20000), 30000
BUILD_S, RUN_S, START_S = 5400, 300, 60  # builds compile everything, without a cache
BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
DATE = "1700000000"
POLICIES = "/usr/local/share/myograde/policies"
PAGE = (SOURCE / "docker/README.md").read_text(encoding="utf-8")


def run(*words, seconds=RUN_S, check=True, cwd=SOURCE, env=None):
    done = subprocess.run([str(word) for word in words], timeout=seconds, capture_output=True, text=True,
                          check=False, cwd=cwd, env=env, stdin=subprocess.DEVNULL)
    if check and done.returncode != 0:
        raise AssertionError(f"{words}: {done.returncode}\n{(done.stdout + done.stderr)[-3000:]}")
    return done


def options(title):
    """The options of the page's list under this heading."""
    section = PAGE.split(f"### {title}\n")[1].split("\n#")[0]
    return re.findall(r"^\| `(--[^`]*)` \|", section, re.MULTILINE)


def limits():
    """An engine's own limits may be above what it may set."""
    return ["--ulimit", f"nofile={FILES}:{FILES}", "--ulimit", f"nproc={PROCESSES}:{PROCESSES}"]


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
        started = run("podman", "run", "--rm", *limits(), BASE, "true", check=False)
        if started.returncode != 0:
            raise unittest.SkipTest("podman starts no containers here: " + started.stderr[-300:])
        build = ("buildah", "build", "--format", "docker", "--network", "host", "--isolation", "chroot", "--build-arg",
                 f"BASE={BASE}")
        # What ./dev setup has fetched need not be fetched again, nor compiled what ccache has.
        run(*build, "--volume", f"{CACHE}:/var/cache/myograde", *cls.compiler_cache(), "--build-arg",
            f"SOURCE_DATE_EPOCH={DATE}", "-f", "docker/server.Dockerfile", "-t", SERVER, ".", seconds=BUILD_S)
        run(*build, "--volume", "/etc/ssl/certs:/etc/ssl/certs:ro", "-f", "docker/participant.Dockerfile",
            "-t", POLICY, ".", seconds=BUILD_S)

    @classmethod
    def compiler_cache(cls):
        """Options that share this host's cache, if it has one, by the paths in the container."""
        if not shutil.which("ccache"):
            return []
        folder = run("ccache", "--get-config", "cache_dir").stdout.strip()
        if not pathlib.Path(folder).is_dir():
            return []
        (cls.root / "ccache").mkdir()
        (cls.root / "ccache/ccache.conf").write_text(
            "base_dir = /src\nhash_dir = false\nsloppiness = pch_defines, time_macros\n", encoding="utf-8")
        return ["--volume", f"{folder}:/root/.cache/ccache", "--volume", f"{cls.root}/ccache:/root/.config/ccache:ro"]

    def server(self, *words, title="Without root", **more):
        return run("podman", "run", "--rm", *limits(), *options(title), *words, **more)

    def wait_for(self, name):
        """Until the daemon in this container answers."""
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

    def test_its_programs_are_an_ordinary_user_s_and_come_with_their_bill_and_licences(self):
        told = self.server("--entrypoint", "sh", SERVER, "-c", "id -u; cat /usr/local/share/doc/myograde/third-party/"
                           "sbom.spdx.json").stdout
        user, bill = told.split("\n", 1)
        self.assertEqual(user, "1000")
        bill = json.loads(bill)
        self.assertEqual(bill["creationInfo"]["created"], "2023-11-14T22:13:20Z")
        self.assertLessEqual({"mujoco", "libssl3", "three"}, {package["name"] for package in bill["packages"]})
        self.server("--entrypoint", "test", SERVER, "-s", "/usr/local/share/doc/myograde/third-party/NOTICE.txt")

    def test_without_the_options_it_says_what_is_missing(self):
        done = run("podman", "run", "--rm", *limits(), SERVER, "doctor", check=False)
        self.assertEqual(done.returncode, 4, done.stdout + done.stderr)
        self.assertIn("missing", done.stdout)

    def folder_of_compose(self):
        """A folder with what the page asks for beside compose.yaml, and the certificate's path."""
        folder = self.root / "compose"
        (folder / "tls").mkdir(parents=True)
        # On a port that nobody listens on here.
        composed = (SOURCE / "docker/compose.yaml").read_text(encoding="utf-8")
        self.assertIn('"8443:8443"', composed)
        with socket.create_server(("", 0)) as free:
            self.url = f"https://localhost:{free.getsockname()[1]}"
        port = self.url.rsplit(":", 1)[1]
        (folder / "compose.yaml").write_text(composed.replace('"8443:', f'"{port}:'), encoding="utf-8")
        config = json.loads((SOURCE / "configs/server.json").read_text(encoding="utf-8"))
        (listen,) = [json.loads(body) for body in re.findall(r"^```json\n(.*?)^```$", PAGE, re.M | re.S)]
        config["http"].update(listen["http"])
        (folder / "server.json").write_text(json.dumps(config), encoding="utf-8")
        (folder / "limits.yaml").write_text(json.dumps({"services": {"myograde": {"ulimits": {
            "nofile": {"soft": FILES, "hard": FILES}, "nproc": {"soft": PROCESSES, "hard": PROCESSES}}}}}))
        return folder

    def renew(self, folder, name):
        """Puts another certificate where the container reads it; returns a copy to trust."""
        certificate, key = make_certificate(self.root, name)
        for source, target in ((certificate, "cert.pem"), (key, "key.pem")):
            (folder / "tls" / target).write_bytes(source.read_bytes())
            os.chown(folder / "tls" / target, 1000, 1000)
        return certificate

    @unittest.skipUnless(shutil.which("podman-compose"), "podman-compose is not installed")
    def test_a_composed_server_serves_tls_and_keeps_its_board(self):
        folder, project = self.folder_of_compose(), f"myograde-test-{os.getpid()}"
        certificate = self.renew(folder, "first")
        name = f"{project}_myograde_1"
        work = {"cwd": folder, "env": {**os.environ, "MYOGRADE_IMAGE": SERVER}}
        compose = ("podman-compose", "-p", project, "-f", "compose.yaml", "-f", "limits.yaml")
        self.addCleanup(run, "podman", "network", "rm", "--force", f"{project}_default", check=False)
        self.addCleanup(run, *compose, "down", "--volumes", check=False, **work)
        up, *again = re.findall(r"^podman-compose (.*)$", PAGE, re.MULTILINE)
        self.assertEqual(again, ["stop", "start", "down"])
        run(*compose, *up.split(), **work)
        self.wait_for(name)
        run("podman", "exec", name, "myograde", "team", "create", "Blue")
        token = json.loads(run("podman", "exec", name, "myograde", "token", "create", "--team", "Blue", "--label",
                               "laptop", "--json").stdout)["token"]
        environment = {**os.environ, "MYOGRADE_SERVER": self.url, "MYOGRADE_CA_FILE": str(certificate),
                       "MYOGRADE_TOKEN": token}

        def ask(*words):
            return json.loads(run(BIN / "myograde", *words, "--json", env=environment).stdout)

        # The image's own: what a build with sanitizers makes needs their libraries.
        run("podman", "cp", f"{name}:{POLICIES}/scripted-elbow", folder)
        done = ask("submit", folder / "scripted-elbow", "--track", "elbow", "--team", "Blue", "--wait")
        self.assertEqual(done["state"], "done", done)
        board = ask("leaderboard", "--track", "elbow")["rows"]
        self.assertEqual([entry["team"] for entry in board], ["Blue"])
        self.assertEqual(run("podman", "healthcheck", "run", name, check=False).returncode, 0)
        # The same container, and a new one on the same volume.
        for end, begin in (("stop", "start"), ("down", up)):
            run(*compose, end, **work)
            with self.assertRaises(urllib.error.URLError):
                self.page(certificate)
            run(*compose, *begin.split(), **work)
            self.wait_for(name)
            self.assertEqual(ask("leaderboard", "--track", "elbow")["rows"], board)
        self.assertEqual(self.page(certificate).status, 200)
        renewed = self.renew(folder, "second")
        run("podman", "kill", "--signal", "HUP", name)
        deadline = time.monotonic() + START_S
        while True:
            try:
                self.assertEqual(self.page(renewed).status, 200)
                break
            except urllib.error.URLError:
                self.assertLess(time.monotonic(), deadline, run("podman", "logs", name).stderr)
                time.sleep(0.5)
        run("podman", "stop", "--time", "60", name)
        self.assertEqual(run("podman", "inspect", "--format", "{{.State.ExitCode}}", name).stdout.strip(), "0")

    def page(self, certificate):
        trust = ssl.create_default_context(cafile=str(certificate))
        with urllib.request.urlopen(self.url + "/", timeout=30, context=trust) as page:
            return page

    def test_a_participant_s_image_has_the_kit(self):
        done = run("podman", "run", "--rm", *limits(), "--network", "none", POLICY, "python3", "-c",
                   "import lcm, myograde, numpy; print(myograde.Policy.__name__)")
        self.assertEqual(done.stdout.strip(), "Policy")


if __name__ == "__main__":
    unittest.main(verbosity=2)
