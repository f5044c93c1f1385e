"""The documents' site in a headless Chromium, as the daemon serves it: at three widths, in light and dark, with
axe-core; its search, and the way to it from the daemon's pages."""

import os
import pathlib
import subprocess
import unittest

from browser_test import WIDTHS, BrowserCase
from documents_test import BIN, MAKE, VERSION, generator

PAGES = ("index", "tour", "CHANGELOG", "policies/GUIDE", "server/cli/index", "server/SECURITY", "configs/index")
# Made of programs and documents, and so long that axe-core takes most of a minute.
LONG_PAGES = ("commands", "server/api/ADDRESSES")
READY = "document.readyState === 'complete' && !document.querySelector('.search').hidden"
FOUND = "!document.querySelector('.found').hidden && document.querySelectorAll('.found li').length"


class Documents(BrowserCase):
    teams = 0

    @classmethod
    def prepare(cls, world):
        folder = world.data.parent / "documents"
        subprocess.run([generator(), "-B", MAKE, folder, VERSION, "--program", BIN / "myograde"], check=True,
                       capture_output=True, timeout=300)
        world.environment["MYOGRADE_DOCS_DIR"] = str(folder)

    def address(self, name):
        return f"/docs/{VERSION}/{name}.html"

    def test_pages_fit_and_are_accessible(self):
        for width in WIDTHS:
            for dark in (False, True):
                page = self.page(width=width, dark=dark)
                for name in PAGES:
                    label = f"docs-{name.replace('/', '-')}-{width}-{'dark' if dark else 'light'}"
                    with self.subTest(label):
                        self.open(page, self.address(name), READY)
                        self.check_page(page, name, label)
                self.check_quiet(page)

    def test_long_pages_fit(self):
        for width in WIDTHS:
            page = self.page(width=width)
            for name in LONG_PAGES:
                self.open(page, self.address(name), READY)
                self.assertLessEqual(page.evaluate("document.documentElement.scrollWidth - innerWidth"), 0, f"{name}, {width}")

    def seek(self, page, words):
        page.evaluate("document.querySelector('.search input').focus()")
        page.evaluate("document.execCommand('selectAll')")
        page.call("Input.insertText", text=words)

    def test_words_are_found_and_lead_to_their_part_of_a_page(self):
        for width in (WIDTHS[0], WIDTHS[-1]):
            page = self.page(width=width)
            self.open(page, self.address("policies/GUIDE"), READY)
            before = len(page.requests)
            self.seek(page, "disk full locked")
            page.wait(FOUND)
            self.check_page(page, "search", f"docs-search-{width}")
            self.assertIn(f"{self.world.url}/docs/{VERSION}/search/search_index.json", page.requests[before:])
            first = page.evaluate("document.querySelector('.found a').textContent")
            self.assertEqual(first, "When the disk is full or the store is locked")
            self.assertGreater(page.evaluate("document.querySelectorAll('.found mark').length"), 0)
            page.evaluate("document.querySelector('.found a').click()")
            page.wait("location.pathname.endsWith('/OPERATIONS.html') && location.hash.length > 1")
            self.assertTrue(page.evaluate("!!document.querySelector(location.hash)"))
            self.check_quiet(page)

    def press(self, page, key):
        for event in ("keyDown", "keyUp"):
            page.call("Input.dispatchKeyEvent", type=event, key=key, code=key,
                      **({"text": "\r"} if (key, event) == ("Enter", "keyDown") else {}))

    def test_questions_and_slips_are_understood(self):
        page = self.page()
        self.open(page, self.address("index"), READY)
        self.seek(page, "How do I submit")
        page.wait(FOUND)
        # Pages for participants come first.
        self.assertNotIn("/server/store", page.evaluate("document.querySelector('.found a').pathname"))
        self.seek(page, "muscel")
        page.wait("document.querySelector('.found [role=status]').textContent.startsWith('Shown for “muscle')")
        self.press(page, "ArrowDown")
        self.press(page, "ArrowDown")
        self.assertEqual(page.evaluate("[...document.querySelectorAll('.found a')].indexOf("
                                       "document.activeElement)"), 1)
        self.press(page, "ArrowUp")
        self.press(page, "ArrowUp")
        self.assertTrue(page.evaluate("document.activeElement.matches('.search input')"))
        self.press(page, "Enter")
        page.wait(f"!location.pathname.endsWith('{self.address('index')}')")
        self.check_quiet(page)

    def test_examples_are_copied(self):
        page = self.page()
        self.open(page, self.address("policies/GUIDE"), READY)
        # The clipboard itself is not a page's to read here.
        page.evaluate("navigator.clipboard.writeText = async (text) => { window.copied = text; }")
        page.evaluate("document.querySelector('.snippet button').click()")
        page.wait("document.querySelector('.snippet button').textContent === 'Copied'")
        self.assertEqual(page.evaluate("window.copied"),
                         page.evaluate("document.querySelector('.snippet pre').textContent.trimEnd()"))

    def test_what_is_typed_is_a_text(self):
        page = self.page()
        self.open(page, self.address("index"), READY)
        for words, said in (("<img src=x onerror=alert(1)>", "Nothing has all of these words."),
                            ("zzz qqq", "Nothing has all of these words.")):
            self.seek(page, words)
            page.wait("document.querySelector('.found [role=status]').textContent === "
                      f"{said!r}")
        self.seek(page, "the")
        page.wait(FOUND)
        self.assertEqual(page.evaluate("document.querySelectorAll('.found li').length"), 20)
        for event in ("keyDown", "keyUp"):
            page.call("Input.dispatchKeyEvent", type=event, key="Escape", code="Escape")
        page.wait("document.querySelector('.found').hidden")
        self.check_quiet(page)

    def test_the_daemon_s_pages_lead_there(self):
        page = self.page()
        self.open(page, "/")
        page.evaluate("document.querySelector('nav a[href=\"/docs\"]').click()")
        page.wait(f"location.pathname === '{self.address('index')}' && ({READY})")
        self.check_quiet(page)


if __name__ == "__main__":
    unittest.main(verbosity=2)
