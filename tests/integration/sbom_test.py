"""The bill of materials names what the programs load, valid by spdx-tools, the same each time, with the
licences of all of it."""

import base64
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest
import zipfile

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
PROGRAMS = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
DATE = "1700000000"
# What the text of a licence says, in small letters.
PHRASES = {
    "Apache-2.0": "apache",
    "MIT": "permission is hereby granted, free of charge",
    "BSD-2-Clause": "redistribution and use in source and binary forms",
    "BSD-3-Clause": "redistribution and use in source and binary forms",
    "GPL-3.0-or-later": "gcc runtime library exception",
    "LGPL-2.0-or-later": "lgpl",
    "LGPL-2.1-only": "lesser general public license",
    "LGPL-2.1-or-later": "lesser general public license",
    "LGPL-3.0-or-later": "lesser general public license",
    "MPL-2.0": "mozilla public license",
    "OLDAP-2.8": "openldap public license",
    "Zlib": "this software is provided 'as-is'",
    "curl": "permission to use, copy, modify, and distribute this software for any purpose",
}
VALIDATE = """
import sys
from spdx_tools.spdx.parser.parse_anything import parse_file
from spdx_tools.spdx.validation.document_validator import validate_full_spdx_document
for found in validate_full_spdx_document(parse_file(sys.argv[1]), "SPDX-2.3"):
    print(found.validation_message)
"""


def make(target, programs=PROGRAMS, source=SOURCE, **environment):
    return subprocess.run(
        [SOURCE / "docker/sbom/sbom.py", "--programs", programs, "--source", source, "--cache", CACHE, "--json",
         target], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "SOURCE_DATE_EPOCH": DATE, **environment})


def validator():
    """The interpreter with spdx-tools; SkipTest if it can't be had here."""
    packages = SOURCE / "docker/spdx.txt"
    digest = hashlib.sha256(packages.read_bytes()).hexdigest()[:12]
    folder = CACHE / f"spdx-{digest}"
    made = subprocess.run([SOURCE / "docker/make_venv.sh", folder, packages], capture_output=True, text=True,
                          timeout=600, check=False)
    if made.returncode != 0:
        raise unittest.SkipTest(f"spdx-tools can't be had here: {made.stdout}{made.stderr}")
    return folder / "bin/python"


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*") if path.is_file()}


class Sbom(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-sbom-"))
        cls.addClassCleanup(shutil.rmtree, cls.root, True)
        cls.folder = cls.root / "a"
        done = make(cls.folder)
        if done.returncode != 0:
            raise AssertionError(done.stdout + done.stderr)
        cls.bill = json.loads((cls.folder / "sbom.spdx.json").read_text(encoding="utf-8"))
        cls.packages = {package["name"]: package for package in cls.bill["packages"]}

    def problems(self, bill):
        path = self.root / "judged.spdx.json"
        path.write_text(json.dumps(bill), encoding="utf-8")
        done = subprocess.run([validator(), "-c", VALIDATE, path], capture_output=True, text=True,
                              timeout=300, check=False)
        return done.stdout + (done.stderr if done.returncode else "")

    def relations(self, name):
        identifier = self.packages[name]["SPDXID"]
        return {entry["relationshipType"] for entry in self.bill["relationships"]
                if identifier in (entry["spdxElementId"], entry["relatedSpdxElement"])}

    def test_spdx_tools_finds_nothing_wrong(self):
        self.assertEqual(self.problems(self.bill), "")

    def test_spdx_tools_would_find_something_wrong(self):
        bill = json.loads(json.dumps(self.bill))
        bill["packages"][1]["licenseDeclared"] = "LicenseRef-of-nothing"
        self.assertNotEqual(self.problems(bill), "")

    def test_the_same_each_time_but_for_the_date(self):
        other = self.root / "b"
        self.assertEqual(make(other, TZ="Asia/Tokyo", LC_ALL="C").returncode, 0)
        self.assertEqual(content(other), content(self.folder))
        self.assertEqual(self.bill["creationInfo"]["created"], "2023-11-14T22:13:20Z")
        self.assertEqual(make(other, SOURCE_DATE_EPOCH="1700000001").returncode, 0)
        later = json.loads((other / "sbom.spdx.json").read_text(encoding="utf-8"))
        self.assertNotEqual(later["documentNamespace"], self.bill["documentNamespace"])
        self.assertEqual(later["packages"], self.bill["packages"])

    def test_libraries_are_those_of_dpkg_with_their_roles(self):
        for name, role in (("libssl3", "DYNAMIC_LINK"), ("libarchive13", "DYNAMIC_LINK"),
                           ("libnghttp2-14", "RUNTIME_DEPENDENCY_OF"), ("libssl-dev", "BUILD_DEPENDENCY_OF"),
                           ("libeigen3-dev", "STATIC_LINK"), ("libsqlitecpp-dev", "STATIC_LINK"),
                           ("mujoco", "DYNAMIC_LINK"), ("three", "CONTAINS"), ("nanobind", "STATIC_LINK"),
                           ("numpy", "RUNTIME_DEPENDENCY_OF"), ("jax", "OPTIONAL_DEPENDENCY_OF")):
            self.assertEqual(self.relations(name), {role}, name)
        told = subprocess.run(["dpkg-query", "-W", "-f", "${Version} ${source:Package}", "libssl3"], check=True,
                              stdout=subprocess.PIPE, text=True).stdout.split()
        package = self.packages["libssl3"]
        self.assertEqual(package["versionInfo"], told[0])
        self.assertIn(f"source package {told[1]} ", package["sourceInfo"])
        self.assertEqual(package["licenseDeclared"], "Apache-2.0")
        # What tests alone use is in no release.
        self.assertFalse({"libgtest-dev", "librapidcheck-dev", "libbenchmark-dev"} & set(self.packages))

    def test_downloads_have_the_digests_that_are_pinned(self):
        pins = "".join((SOURCE / file).read_text(encoding="utf-8") for file in (
            "docker/wheels.txt", "docker/nanobind.txt", "docker/three.txt",
            "policies/runtimes/python/requirements.txt"))
        for name in ("mujoco", "myosuite", "nanobind", "three", "numpy", "lcm"):
            checksum, = self.packages[name]["checksums"]
            self.assertIn(f"sha256:{checksum['checksumValue']}", pins, name)

    def test_every_part_of_a_release_has_the_text_of_its_licence(self):
        notice = (self.folder / "NOTICE.txt").read_text(encoding="utf-8")
        for line in notice.splitlines():
            if line.startswith("  "):
                self.assertGreater((self.folder / line.strip()).stat().st_size, 100, line)
        for name in ("debian/libssl3/copyright", "debian/libeigen3-dev/copyright", "python/mujoco-2.2.2/LICENSE",
                     "python/mujoco-2.2.2/LICENSES_THIRD_PARTY.md", "python/myo_sim/LICENSE",
                     "web/three/copyright", "common-licenses/LGPL-2.1"):
            self.assertIn(f"  {name}\n", notice)
        self.assertIn("three.js authors", (self.folder / "web/three/copyright").read_text(encoding="utf-8"))

    def test_the_texts_are_of_the_licences_that_the_bill_states(self):
        judged = set()
        for name, package in self.packages.items():
            words = PHRASES.get(package["licenseDeclared"].split(" ")[0])
            files = [*self.folder.glob(f"debian/{name}/*"), *self.folder.glob(f"web/{name}/*"), *(
                path for path in self.folder.glob(f"python/{name}-*/**/*") if path.is_file())]
            if not words or not files:
                continue
            text = " ".join(path.read_text(encoding="utf-8", errors="replace") for path in files)
            self.assertIn(words, " ".join(text.replace("\n .\n", "\n").split()).lower(), name)
            judged.add(name)
        self.assertLessEqual({"mujoco", "myosuite", "numpy", "lcm", "nanobind", "three", "libssl3", "libc6"}, judged)

    def test_a_wheel_gets_the_licences_of_what_it_brings(self):
        # The simulator is made of what the extension is made of.
        wheel, program = self.root / "myograde-7.0-cp311-cp311-linux_x86_64.whl", PROGRAMS / "myograde-sim"
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr("myograde/__init__.py", "")
            archive.writestr("myograde.libs/libzstd-01234567.so.1.5.4", b"")
            archive.writestr("myograde.libs/libmujoco-89abcdef.so.2.2.2", b"")
            archive.writestr("myograde-7.0.dist-info/RECORD", "myograde/__init__.py,,\n"
                             "myograde-7.0.dist-info/RECORD,,\n")

        def add():
            return subprocess.run([SOURCE / "docker/sbom/wheel_licences.py", wheel, "--extension", program, "--cache",
                                   CACHE], capture_output=True, text=True, timeout=300, check=False)

        real = {pathlib.Path(line.split(" => ")[1].split(" (")[0]).resolve().name for line in subprocess.run(
            ["ldd", program], check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines() if " => " in line}
        if "libzstd.so.1.5.4" not in real:
            self.skipTest("the libraries are not those of Debian 12")
        done = add()
        self.assertEqual(done.returncode, 0, done.stderr)
        before = wheel.read_bytes()
        self.assertEqual(add().returncode, 0)
        self.assertEqual(wheel.read_bytes(), before)
        with zipfile.ZipFile(wheel) as archive:
            third = "myograde-7.0.dist-info/licenses/third-party/"
            names = {name.removeprefix(third) for name in archive.namelist() if name.startswith(third)}
            self.assertLessEqual({"NOTICE.txt", "debian/libzstd1/copyright", "debian/libeigen3-dev/copyright",
                                  "python/mujoco-2.2.2/LICENSE", "common-licenses/GPL-2"}, names)
            self.assertFalse({name for name in names if "libssl" in name or "libcurl" in name or "numpy" in name})
            for line in archive.read("myograde-7.0.dist-info/RECORD").decode().splitlines():
                name, digest, size = line.rsplit(",", 2)
                if digest:
                    data = archive.read(name)
                    found = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
                    self.assertEqual((digest, size), (f"sha256={found}", str(len(data))))
                    names.discard(name.removeprefix(third))
            self.assertEqual(names, set())
        with zipfile.ZipFile(wheel, "a") as archive:
            archive.writestr("myograde.libs/libstranger-00000000.so.1", b"")
        done = add()
        self.assertEqual(done.returncode, 4)
        self.assertRegex(done.stderr, r"^error: .*libstranger\.so\.1[^\n]*\n$")

    def test_what_is_wrong_is_said_in_a_sentence(self):
        empty = self.root / "empty"
        empty.mkdir()
        for words, environment, sentence in (
                ({"programs": empty}, {}, "holds no program"),
                ({"programs": self.root / "nowhere"}, {}, "is not a folder"),
                ({}, {"SOURCE_DATE_EPOCH": "soon"}, "must be seconds since 1970")):
            done = make(self.root / "c", **words, **environment)
            self.assertEqual(done.returncode, 4, done.stdout + done.stderr)
            self.assertRegex(done.stderr, f"^error: .*{sentence}[^\n]*\n$")


if __name__ == "__main__":
    unittest.main(verbosity=2)
