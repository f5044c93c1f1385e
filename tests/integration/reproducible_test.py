"""Two builds of the same sources in folders of different names, by users with different habits, install
the same bytes. Takes about twelve minutes of processor time: nothing comes from a compiler cache."""

import hashlib
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TARGETS = ("myograde", "myograded", "myograde-runner", "myograde-node", "myograde-sim", "myograde-bridge",
           "myograde-render", "myograde_policies", "myograde_policy_kit")
LONGEST_S = 3000  # that one build may take


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


class Reproducible(unittest.TestCase):
    def run_quietly(self, *words, cwd, **environment):
        done = subprocess.run(words, cwd=cwd, timeout=LONGEST_S, capture_output=True, text=True,
                              check=False, env={**os.environ, **environment})
        self.assertEqual(done.returncode, 0, (done.stdout + done.stderr)[-3000:])

    def build(self, source, jobs, **environment):
        cache = os.environ["MYOGRADE_CACHE"]
        environment = {"CCACHE_DISABLE": "1", **environment}
        self.run_quietly("cmake", "--preset", "release", f"-DMYOGRADE_CACHE={cache}", cwd=source,
                         **environment)
        self.run_quietly("cmake", "--build", "build/release", "-j", jobs, "--target", *TARGETS, cwd=source,
                         **environment)
        self.run_quietly("cmake", "--install", "build/release", "--prefix", source / "installed", cwd=source,
                         **environment)
        return source / "installed"

    def test_two_builds_install_the_same_bytes(self):
        root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-reproducible-"))
        self.addCleanup(shutil.rmtree, root, True)
        trees = []
        for name, jobs, environment in (
                ("a", "2", {"TZ": "UTC", "LC_ALL": "C.UTF-8"}),
                ("another-folder/with-a-longer-name", "1",
                 {"TZ": "Asia/Tokyo", "LC_ALL": "C", "HOME": str(root), "USER": "somebody"})):
            source = root / name
            source.mkdir(parents=True)
            copy_sources(source)
            trees.append(content(self.build(source, jobs, **environment)))
        self.assertIn("bin/myograde-sim", trees[0])
        self.assertEqual(set(trees[0]), set(trees[1]))
        self.assertEqual([name for name in trees[0] if trees[0][name] != trees[1][name]], [])

    def test_a_program_names_no_folder_of_its_build(self):
        build = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent
        cache = (build / "CMakeCache.txt").read_text(encoding="utf-8")
        if "MYOGRADE_SANITIZE:STRING=\n" not in cache:
            self.skipTest("programs with sanitizers name their sources in reports")
        for program in sorted((build / "bin").iterdir()):
            self.assertNotIn(os.fsencode(SOURCE), program.read_bytes(), program.name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
