"""Two builds of the same sources in folders of different names, by users with different habits, give the
same bytes: installed programs, Debian packages, the bill of materials, the documents' site and the Python
package. Takes about half an hour of processor time: nothing comes from a compiler cache.

MYOGRADE_TEST_KEEP: keeps both folders, to look at what differs."""

import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CACHE = os.environ["MYOGRADE_CACHE"]
TARGETS = ("myograde", "myograded", "myograde-runner", "myograde-node", "myograde-sim", "myograde-bridge",
           "myograde-render", "myograde-unpack", "myograde_policies", "myograde_policy_kit", "myograde_debian")
PACKAGES = {"libmyograde-policy-dev", "myograde-client", "myograde-server", "python3-myograde"}
DATE = "1700000000"
# The site is part of a build where its generator is in the cache, which tests beside this one may fill.
GENERATOR = hashlib.sha256((SOURCE / "docker/docs.txt").read_bytes()).hexdigest()[:12]
SITE = ["docs"] if pathlib.Path(CACHE, f"docs-{GENERATOR}/complete").exists() else []
LONGEST_S = 5400  # that one build may take


def copy_sources(folder):
    """What git knows of the sources, as it is now."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=SOURCE, check=True,
                           stdout=subprocess.PIPE).stdout.decode().split("\0")
    for name in filter(None, names):
        if (SOURCE / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(SOURCE / name, folder / name)


def content(folder):
    """Path -> SHA-256, or where a link leads."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


class Build:
    """A build in `source`, as somebody with these variables and this umask makes it."""

    def __init__(self, source, umask, environment):
        self.source, self.umask = source, umask
        self.environment = {**os.environ, "CCACHE_DISABLE": "1", "SOURCE_DATE_EPOCH": DATE, **environment}
        self.out = source / "out"

    def run(self, *words, skips=False, umask=None):
        """Returns whether it worked; AssertionError if not, unless it `skips` (exit status 77)."""
        done = subprocess.run([str(word) for word in words], cwd=self.source, timeout=LONGEST_S,
                              capture_output=True, text=True, check=False, env=self.environment,
                              umask=self.umask if umask is None else umask, stdin=subprocess.DEVNULL)
        if done.returncode != 0 and not (skips and done.returncode == 77):
            raise AssertionError(f"{words}: {done.returncode}\n{(done.stdout + done.stderr)[-3000:]}")
        return done.returncode == 0

    def make(self):
        """Fills `out` with what a release is made of, a folder for each kind."""
        self.run("cmake", "--preset", "release", f"-DMYOGRADE_CACHE={CACHE}")
        self.run("cmake", "--build", "build/release", "-j", os.cpu_count(), "--target", *TARGETS, *SITE)
        self.run("docker/sbom/sbom.py", "--programs", "build/release/bin", "--cache", CACHE,
                 "build/release/third-party")
        self.run("cmake", "--install", "build/release", "--prefix", self.out / "installed")
        # As ./dev package does it.
        self.run("cpack", "--config", "build/release/CPackConfig.cmake", "-G", "DEB", "-B", self.out / "packages",
                 umask=0o022)
        shutil.rmtree(self.out / "packages/_CPack_Packages", ignore_errors=True)
        self.run("policies/python/wheel.sh", "--pure", self.out / "wheels", f"3.{sys.version_info.minor}", skips=True)


class Reproducible(unittest.TestCase):
    def test_two_builds_give_the_same_bytes(self):
        root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-reproducible-"))
        if "MYOGRADE_TEST_KEEP" not in os.environ:
            self.addCleanup(shutil.rmtree, root, True)
        trees = []
        for name, umask, environment in (
                ("a", 0o022, {"TZ": "UTC", "LC_ALL": "C.UTF-8"}),
                ("another-folder/with-a-longer-name", 0o027,
                 {"TZ": "Asia/Tokyo", "LC_ALL": "C", "HOME": str(root), "USER": "somebody"})):
            source = root / name
            source.mkdir(parents=True)
            copy_sources(source)
            build = Build(source, umask, environment)
            build.make()
            trees.append(content(build.out))
        first, second = trees
        self.assertLessEqual({"installed/bin/myograde-sim", "installed/share/doc/myograde/third-party/sbom.spdx.json",
                              "installed/share/myograde/policies/scripted-elbow/scripted-elbow",
                              "installed/lib/libmyograde-policy.a"}, set(first))
        self.assertEqual({name.split("/")[1].split("_")[0] for name in first if name.endswith(".deb")}, PACKAGES)
        self.assertEqual(set(first), set(second))
        self.assertEqual([name for name in first if first[name] != second[name]], [], root)

    def test_a_program_names_no_folder_of_its_build(self):
        build = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent
        cache = (build / "CMakeCache.txt").read_text(encoding="utf-8")
        if "MYOGRADE_SANITIZE:STRING=\n" not in cache:
            self.skipTest("programs with sanitizers name their sources in reports")
        for program in sorted((build / "bin").iterdir()):
            self.assertNotIn(os.fsencode(SOURCE), program.read_bytes(), program.name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
