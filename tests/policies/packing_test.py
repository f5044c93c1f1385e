"""What the Python client makes of a submission before it is sent. Needs no server."""

import contextlib
import io
import json
import os
import pathlib
import shutil
import stat
import tarfile
import tempfile
import unittest
import zipfile

from myograde.client import MyogradeError, WrongUse, flat, marks_of, numbers_of
from myograde.client.archive import pack
from support import images


class Packing(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def refused(self, path):
        with self.assertRaises(WrongUse) as wrong:
            pack(path, io.BytesIO())
        return str(wrong.exception)

    def test_what_cant_be_packed_is_named(self):
        self.assertIn("no such folder", self.refused(self.folder / "none"))
        self.assertIn("has no policy.json", self.refused(self.folder))
        (self.folder / "policy.json").write_text("{}")
        os.mkfifo(self.folder / "pipe")
        self.assertIn("pipe: is not a file", self.refused(self.folder))
        (self.folder / "pipe").unlink()
        (self.folder / "tool").write_text("x")
        self.assertIn("is not a program", self.refused(self.folder / "tool"))
        (self.folder / "tool").write_text("#!/bin/sh\n")
        self.assertIn("is not executable", self.refused(self.folder / "tool"))
        (self.folder / "tool").chmod(0o4755)
        self.assertIn("setuid", self.refused(self.folder))
        (self.folder / "broken.zip").write_text("x")
        self.assertIn("zip archive", self.refused(self.folder / "broken.zip"))
        with zipfile.ZipFile(self.folder / "link.zip", "w") as archive:
            link = zipfile.ZipInfo("far")
            link.external_attr = (stat.S_IFLNK | 0o777) << 16
            archive.writestr(link, b"a" * 5000)
        self.assertIn("the link far is too long", self.refused(self.folder / "link.zip"))

    def test_a_zip_archive_that_is_too_large_or_broken(self):
        whole = io.BytesIO()
        with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("policy.json", b"{}" + b" " * 9998)
        (self.folder / "a.zip").write_bytes(whole.getvalue())
        pack(self.folder / "a.zip", io.BytesIO(), largest_bytes=10_000)
        with self.assertRaisesRegex(WrongUse, "a.zip: unpacked, it has more than 9999 bytes; make it smaller"):
            pack(self.folder / "a.zip", io.BytesIO(), largest_bytes=9_999)
        for place in range(0, len(whole.getvalue()), 3):  # whatever the decompressor says to it
            torn = bytearray(whole.getvalue())
            torn[place] ^= 0xff
            (self.folder / "a.zip").write_bytes(torn)
            with contextlib.suppress(WrongUse):
                pack(self.folder / "a.zip", io.BytesIO())
        (self.folder / "a.zip").write_bytes(whole.getvalue()[:50] + b"torn" + whole.getvalue()[54:])
        self.assertIn("a.zip: can't be read as a zip archive", self.refused(self.folder / "a.zip"))

    def test_a_full_disk_is_not_the_submissions_fault(self):
        (self.folder / "policy.json").write_text("{}")
        with open("/dev/full", "wb", buffering=0) as target, self.assertRaisesRegex(MyogradeError, "No space left .*TMPDIR") as full:
            pack(self.folder, target)
        self.assertNotIsInstance(full.exception, WrongUse)

    def test_the_same_folder_makes_the_same_bytes(self):
        (self.folder / "policy.json").write_text("{}")
        (self.folder / "lost").symlink_to("nowhere")
        archives = [io.BytesIO(), io.BytesIO()]
        for archive in archives:
            pack(self.folder, archive)
        self.assertEqual(archives[0].getvalue(), archives[1].getvalue())

    def test_archives_are_known_by_their_first_bytes(self):
        folder = self.folder / "p"
        folder.mkdir()
        (folder / "policy.json").write_text("{}")
        for form in ("tar", "gztar", "bztar", "xztar", "zip"):
            made = pathlib.Path(shutil.make_archive(str(self.folder / "p"), form, folder))
            for name in ("walker", "A.SAVED"):
                made = made.rename(self.folder / name)
                self.assertEqual(self.name_in(made, "mine"), "mine", form)

    def name_in(self, place, name):
        archive = io.BytesIO()
        pack(place, archive, name)
        archive.seek(0)
        with tarfile.open(fileobj=archive) as packed:
            self.assertEqual(packed.getnames().count("policy.json"), 1)
            about = json.load(packed.extractfile("policy.json"))
            files = {os.path.normpath(name) for name in packed.getnames()} - {".", "policy.json"}
            self.assertLessEqual(files, {about.get("image", "policy")})
        return about["name"]

    def test_a_given_name_comes_over_the_submissions(self):
        for kind, about in (("nameless", {"command": ["./policy"]}),
                            ("named", {"name": "first", "command": ["./policy"]})):
            folder = self.folder / kind
            folder.mkdir()
            (folder / "policy.json").write_text(json.dumps(about))
            (folder / "policy").write_text("#!/bin/sh\n")
            (folder / "policy").chmod(0o755)
            for form in ("gztar", "tar", "zip"):
                shutil.make_archive(str(folder), form, folder)
            for place in ("", "/policy", ".tar.gz", ".tar", ".zip"):
                self.assertEqual(self.name_in(f"{folder}{place}", "second é"), "second é", place)
        image = self.folder / "agent.tar"
        image.write_bytes(images.image([[images.member("run", b"#!/bin/sh\n", mode=0o755)]]))
        self.assertEqual(self.name_in(image, "mine"), "mine")
        (self.folder / "x.tar.zst").write_bytes(b"\x28\xb5\x2f\xfd")
        (self.folder / "named/policy.json").write_text("[]")
        for place, name, words in (("nameless", "", "name is empty"),
                                   ("x.tar.zst", "x", "into its policy.json"),
                                   ("named", "x", "is not an object")):
            with self.assertRaisesRegex(WrongUse, words):
                pack(self.folder / place, io.BytesIO(), name)

    def test_records_are_flat(self):
        self.assertEqual(flat({"a": {"b": {"c": 1}}, "d": [1], "e": {}}), {"a.b.c": 1, "d": [1]})

    def test_numbers_and_marks(self):
        spread = {"success_rate": {"deviation": 0.1, "low": 0.25, "high": 0.75}, "time_s": None}
        self.assertEqual(numbers_of({"success_rate": 0.5, "time_s": None, "score": float("inf"), "spread": spread}),
                         {"success_rate": 0.5, "time_s": None, "score": None, "success_rate.error": 0.25,
                          "time_s.error": None})
        acts = [{"mark": mark, "set": is_set, "reason": reason} for mark, is_set, reason in (
            ("hidden", True, "a"), ("baseline", True, "b"), ("hidden", False, "c"), ("baseline", True, "d"))]
        self.assertEqual(marks_of({"marks": acts}), {"baseline": acts[-1]})


if __name__ == "__main__":
    unittest.main(verbosity=2)
