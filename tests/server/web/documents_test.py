"""The documents' site: it is made without a warning, every link and anchor leads somewhere, it needs
nothing but itself, the daemon serves it under /docs, and a wrong page or link ends the build."""

import hashlib
import html
import html.parser
import json
import os
import pathlib
import posixpath
import re
import shutil
import subprocess
import tempfile
import unittest
import urllib.parse

from support import client
from support.daemon import Daemon

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
MAKE = SOURCE / "server/docs/make_site.py"
VERSION = (SOURCE / "CMakeLists.txt").read_text().split("(myograde VERSION ")[1].split(" ")[0].rsplit(".", 1)[0]
AUDIENCES = {"Participants", "Organisers", "Operators", "Developers"}
# Addresses of the daemon that every page names.
DAEMONS = {"/", "/queue", "/team", "/submit", "/v1/openapi.json", "/web/icon.svg"}


class Page(html.parser.HTMLParser):
    """Links, anchors and whatever the Content-Security-Policy would refuse."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.refused, self.loaded = [], set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            if tag == "a" and name == "href":
                self.links.append(value)
            if (tag, name) in (("link", "href"), ("img", "src"), ("script", "src")):
                self.loaded.append(value)
            if name == "style" or name.startswith("on"):
                self.refused.append((tag, name))
        if tag in ("style", "iframe", "object", "embed", "form") or \
                tag == "script" and "src" not in dict(attrs):
            self.refused.append(tag)


def generator():
    """The interpreter with MkDocs; SkipTest if it can't be had here."""
    packages = SOURCE / "docker/docs.txt"
    digest = hashlib.sha256(packages.read_bytes()).hexdigest()[:12]
    folder = pathlib.Path(os.environ["MYOGRADE_CACHE"]) / f"docs-{digest}"
    made = subprocess.run([SOURCE / "docker/make_venv.sh", folder, packages], capture_output=True,
                          text=True, timeout=600, check=False)
    if made.returncode != 0:
        raise unittest.SkipTest(f"the site can't be made here: {made.stdout}{made.stderr}")
    return folder / "bin/python"


def setUpModule():
    global PYTHON, ROOT
    PYTHON = generator()
    ROOT = pathlib.Path(tempfile.mkdtemp(prefix="myograde-documents-"))
    unittest.addModuleCleanup(shutil.rmtree, ROOT)
    done = make(ROOT / "docs", VERSION)
    if done.returncode != 0:
        raise AssertionError(done.stdout + done.stderr)


def make(out, *words, program=BIN / "myograde"):
    return subprocess.run([PYTHON, "-B", MAKE, out, "--program", program, *words], capture_output=True, text=True,
                          timeout=300, check=False)


class Site(unittest.TestCase):
    def pages(self):
        site = ROOT / "docs" / VERSION
        return {path.relative_to(site).as_posix(): Page(path.read_text(encoding="utf-8"))
                for path in site.rglob("*.html")}

    def test_every_page_is_there_and_every_link_leads_somewhere(self):
        pages = self.pages()
        listed = json.loads((SOURCE / "server/docs/site.json").read_text())["audiences"]
        self.assertEqual(set(listed), AUDIENCES)
        self.assertEqual(len(pages), sum(map(len, listed.values())) + 2, "the first page and the list of commands, too")
        checked = 0
        for name, page in pages.items():
            self.assertEqual(page.refused, [], name)
            for link in page.links + page.loaded:
                parts = urllib.parse.urlsplit(link)
                if parts.scheme or link in DAEMONS:
                    self.assertIn(parts.scheme, ("", "https"), f"{name}: {link}")
                    continue
                self.assertFalse(link.startswith("/"), f"{name}: {link}")
                target = posixpath.normpath(posixpath.join(posixpath.dirname(name), parts.path)) \
                    if parts.path else name
                self.assertTrue((ROOT / "docs" / VERSION / target).is_file(), f"{name}: {link}")
                if parts.fragment and parts.fragment != "main":
                    self.assertIn(parts.fragment, pages[target].anchors, f"{name}: {link}")
                checked += 1
            for link in page.loaded:
                self.assertEqual(urllib.parse.urlsplit(link)[:2], ("", ""), f"{name}: {link}")
        self.assertGreater(checked, 1000)

    def test_paths_of_other_pages_are_links(self):
        tour = self.pages()["tour.html"]
        self.assertIn("policies/GUIDE.html", tour.links)
        self.assertIn("configs/challenges/MANUAL.html", tour.links)

    def test_the_first_page_says_where_each_reader_starts(self):
        starts = json.loads((SOURCE / "server/docs/site.json").read_text())["starts"]
        self.assertEqual(set(starts), AUDIENCES)
        links = self.pages()["index.html"].links
        for page in ("policies/GUIDE.html", "configs/challenges/MANUAL.html", "docker/debian/index.html", "tour.html"):
            # In the sentence and in the list below it, beside the navigation.
            self.assertGreaterEqual(links.count(page), 3, page)

    def test_the_list_of_commands_is_what_the_program_says(self):
        text = (ROOT / "docs" / VERSION / "commands.html").read_text(encoding="utf-8")
        titles = set(re.findall(r"<code>([^<]+)</code></h\d>", text.replace('<span class="word">', "").replace("</span>", "")))
        self.assertLessEqual({"submit", "episode replay", "phase seeds reveal"}, titles)
        self.assertIn("Submit a policy for grading.", text)

    def test_code_is_shown_as_it_is_typed(self):
        text = (ROOT / "docs" / VERSION / "server/cli/index.html").read_text(encoding="utf-8")
        self.assertIn('<span class="word">--episodes</span>', text)
        commands = (ROOT / "docs" / VERSION / "commands.html").read_text(encoding="utf-8")
        self.assertIn('<span class="word">TEXT:{cpp,python,torch}</span>', commands)
        # Blocks of code are left alone, and so is what is too long for a line.
        guide = (ROOT / "docs" / VERSION / "policies/GUIDE.html").read_text(encoding="utf-8")
        for block in re.findall(r"<pre.*?</pre>", guide, re.DOTALL):
            self.assertNotIn('class="word"', block)
        for word in re.findall(r'<span class="word">([^<]*)</span>', text):
            self.assertLessEqual(len(html.unescape(word)), 30)

    def copy(self):
        """A small tree with one page for each audience."""
        tree = pathlib.Path(tempfile.mkdtemp(dir=ROOT))
        for page in json.loads((SOURCE / "server/docs/site.json").read_text())["audiences"].values():
            for name in page:
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(SOURCE / name, tree / name)
        return tree

    def test_a_wrong_page_or_link_ends_the_build_with_its_name(self):
        without_verbs = ROOT / "without-verbs"  # answers at once
        without_verbs.write_text("#!/bin/sh\necho 'Does nothing.'\necho 'Usage: none'\n")
        without_verbs.chmod(0o755)
        for page, text, said in (
                ("policies/new.md", "# New\n", "say in server/docs/site.json whom it is for"),
                ("README.md", "# Tour\n[away](nowhere.md)\n", "nowhere.md"),
                ("README.md", "# Tour\n[away](policies/GUIDE.md#no-such-part)\n", "no-such-part"),
                ("README.md", "# Tour\n`nowhere/README.md` says so.\n", "no page nowhere/README.md"),
                ("sim/README.md", "Tour\n", "no heading"),
                ("sim/README.md", "# Tour\nIt holds\n- models\n", "empty line before it: - models")):
            with self.subTest(said=said):
                tree = self.copy()
                (tree / page).write_text(text)
                done = make(tree / "out", VERSION, "--source", tree, program=without_verbs)
                self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
                self.assertIn(said, done.stderr)
                self.assertFalse((tree / "out").exists())
        self.assertEqual(make(ROOT / "bad", "newest").returncode, 2)


class Served(unittest.TestCase):
    def test_the_page_of_addresses_has_each_of_the_daemon(self):
        text = (ROOT / "docs" / VERSION / "server/api/ADDRESSES.html").read_text(encoding="utf-8")
        text = text.replace('<span class="word">', "").replace("</span>", "")
        shown = re.findall(r"<h3[^>]*><code>(.+)</code></h3>\n<p><strong>.+</strong> For .+</p>", text)
        there = json.loads(self.ask(self.serve(ROOT / "docs"), "/v1/addresses")[2])["addresses"]
        self.assertEqual(sorted(re.sub(r"\{\w+\}", "*", title) for title in shown),
                         sorted(re.sub(r"\b(ID|HASH|NAME)\b", "*", f"{one['method']} {one['path']}") for one in there))
        linked = re.findall(r'<td><a href="#[^"]+"><code>([^<]+)</code></a></td>', text)
        self.assertEqual(sorted(linked), sorted(shown), "the tables at the top")

    def serve(self, folder):
        daemon = Daemon(BIN, SOURCE, "documents")
        self.addCleanup(daemon.close)
        daemon.environment["MYOGRADE_DOCS_DIR"] = str(folder)
        daemon.start()
        return daemon

    def ask(self, daemon, path, **headers):
        connection = client.Connection(daemon.socket_path)
        try:
            connection.request("GET", path, headers=headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode()
        finally:
            connection.close()

    def test_the_daemon_serves_it_from_memory(self):
        folder = pathlib.Path(tempfile.mkdtemp(dir=ROOT))
        shutil.copytree(ROOT / "docs" / VERSION, folder / VERSION)
        (folder / "0.0").mkdir()
        (folder / "0.0/index.html").write_text("<title>earlier</title>")
        (folder / "secret.txt").write_text("not a page")
        (folder / "link.html").symlink_to("/etc/passwd")
        daemon = self.serve(folder)
        status, headers, _ = self.ask(daemon, "/docs")
        self.assertEqual((status, headers["Location"]), (302, f"/docs/{VERSION}/index.html"))
        for path, page in (("/", "index.html"), (f"/{VERSION}", "index.html"), (f"/{VERSION}/", "index.html"),
                           ("/0.1", "index.html"), ("/0.1/policies/GUIDE.html", "policies/GUIDE.html"),
                           ("/12.34/index.html", "index.html")):
            status, headers, _ = self.ask(daemon, "/docs" + path)
            self.assertEqual((status, headers["Location"]), (302, f"/docs/{VERSION}/{page}"), path)
        for name, kind in (("index.html", "text/html"), ("docs.css", "text/css"), ("search.js", "text/javascript"),
                           ("search/search_index.json", "application/json"),
                           ("server/daemon/OPERATIONS.html", "text/html")):
            status, headers, body = self.ask(daemon, f"/docs/{VERSION}/{name}")
            self.assertEqual(status, 200, name)
            self.assertEqual(body, (folder / VERSION / name).read_text(), name)
            self.assertEqual(headers["Content-Type"].split(";")[0], kind)
            self.assertIn("default-src 'none'", headers["Content-Security-Policy"])
            again = self.ask(daemon, f"/docs/{VERSION}/{name}", **{"If-None-Match": headers["ETag"]})
            self.assertEqual((again[0], again[2]), (304, ""))
        self.assertIn("earlier", self.ask(daemon, "/docs/0.0/index.html")[2])
        for path in ("/docs/secret.txt", "/docs/link.html", "/docs/../store.db", "/docs/%2e%2e/store.db",
                     f"/docs/{VERSION}/none.html", "/docs//etc/passwd", "/docs/0.1/none.html",
                     "/docs/0.0/policies/GUIDE.html", "/docs/./index.html", "/docs/1../index.html",
                     "/docs/" + "a/" * 1000):
            self.assertIn(self.ask(daemon, path)[0], (400, 404, 414), path)
        (folder / VERSION / "index.html").write_text("changed")
        self.assertNotIn("changed", self.ask(daemon, f"/docs/{VERSION}/index.html")[2])

    def test_without_a_site_it_says_how_to_make_one(self):
        daemon = self.serve(ROOT / "nothing")
        status, _, body = self.ask(daemon, "/docs")
        self.assertEqual(status, 404)
        self.assertIn("./dev docs", body)


if __name__ == "__main__":
    unittest.main(verbosity=2)
