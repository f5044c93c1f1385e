"""Figures and reports as files: well-formed, reproducible, readable by everybody, and without a
participant's markup. Skipped where matplotlib is missing. usage: drawings_test.py SOURCE_DIR"""

import html.parser
import json
import pathlib
import re
import subprocess
import sys
import unittest
import xml.etree.ElementTree as ET

PROGRAM = pathlib.Path(sys.argv[1]).resolve() / "server/figures"
sys.path.insert(0, str(PROGRAM))

try:
    import matplotlib  # pylint: disable=unused-import
except ImportError:
    print("skipped: this host has no matplotlib (Debian's python3-matplotlib)")
    sys.exit(77)

import answers  # pylint: disable=wrong-import-position
import phase_report  # pylint: disable=wrong-import-position
import plots  # pylint: disable=wrong-import-position
import submission_report  # pylint: disable=wrong-import-position

SVG = "{http://www.w3.org/2000/svg}"
HTML_TAGS = {"html", "head", "meta", "title", "style", "body", "main", "h1", "h2", "section", "p",
             "dl", "dt", "dd", "div", "table", "caption", "thead", "tbody", "tr", "th", "td", "bdi",
             "code", "span", "br", "figure", "figcaption", "img", "details", "summary", "pre"}
SVG_TAGS = {"svg", "g", "defs", "path", "use", "text", "tspan", "clippath", "rect", "pattern",
            "style", "metadata"}
PNG = "iVBORw0KGgo="


def plot(kind, format_="svg", **parts):
    order = {"make": "plot", "kind": kind, "format": format_, **parts}
    return plots.made(order)[1]


def hostile_results():
    """A submission for each hostile text, as team and as name."""
    return [answers.result(7 + place, team=text, name=text, episodes=10)
            for place, text in enumerate(answers.HOSTILE)]


def parts_of(kind, results):
    if kind == "board":
        return answers.board_order(results)
    if kind == "paired":
        return {"results": results[:2], "paired": answers.paired(*results[:2])}
    return {"results": results[:1] if kind == "distributions" else results[:4]}


class Page(html.parser.HTMLParser):
    """Which elements and addresses a page has, and its texts."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.addresses, self.handlers, self.texts, self.policy = set(), [], [], [], ""
        self.ids = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        attributes = dict(attrs)
        if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy":
            self.policy = attributes["content"]
        self.handlers += [name for name in attributes if name.startswith("on")]
        self.addresses += [value for name, value in attrs
                           if name in ("src", "href", "xlink:href", "action", "data")]
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_data(self, data):
        self.texts.append(data)


class Files(unittest.TestCase):
    def test_every_kind_is_an_svg_with_text_and_units(self):
        units = {"board": "time (UTC)", "distributions": "Distance (m)",
                 "courses": "mean distance (m)", "survival": "simulated time (s)",
                 "joints": "angle (°)", "paired": "difference (m)"}
        results = [answers.result(7), answers.result(9, "beta"), answers.result(11, "base")]
        for kind, unit in units.items():
            with self.subTest(kind=kind):
                tree = ET.fromstring(plot(kind, **parts_of(kind, results)))
                texts = {"".join(text.itertext()) for text in tree.iter(f"{SVG}text")}
                self.assertIn(unit, texts)
                self.assertNotIn(f"{SVG}script", {element.tag for element in tree.iter()})

    def test_a_pdf_has_its_fonts_and_no_date(self):
        file = plot("courses", "pdf", results=[answers.result(7)])
        self.assertTrue(file.startswith(b"%PDF-"))
        self.assertIn(b"/FontFile2", file)  # TrueType, embedded
        self.assertNotIn(b"/Type3", file)
        self.assertNotIn(b"CreationDate", file)

    def test_the_same_numbers_give_the_same_bytes(self):
        for format_ in ("svg", "pdf"):
            order = {"make": "plot", "kind": "survival", "format": format_,
                     "results": [answers.result(7)]}
            here = plots.made(order)[1]
            done = subprocess.run(["/usr/bin/python3", "-I", "-B", PROGRAM], check=True, timeout=120,
                                  input=json.dumps(order).encode(), capture_output=True)
            self.assertEqual(done.stdout.partition(b"\n")[2], here)

    def test_small_and_odd_results_can_be_drawn(self):
        one = answers.result(7, episodes=1)
        for kind in ("distributions", "courses", "survival", "joints"):
            ET.fromstring(plot(kind, results=[one]))


class Hostile(unittest.TestCase):
    def test_no_text_of_a_participant_is_markup_in_a_figure(self):
        for kind in ("board", "courses", "distributions", "paired"):
            for start in (0, 4, 8):
                results = hostile_results()[start:start + 4]
                with self.subTest(kind=kind, start=start):
                    file = plot(kind, **parts_of(kind, results))
                    tree = ET.fromstring(file)  # so it is well-formed, too
                    tags = {element.tag for element in tree.iter() if SVG in element.tag}
                    self.assertLessEqual({tag.removeprefix(SVG).lower() for tag in tags}, SVG_TAGS)
                    plot(kind, "pdf", **parts_of(kind, results))

    def test_a_formula_stays_the_text_that_it_is(self):
        result = answers.result(7, team="$\\frac{1}{0}$", name="$x^2$")
        text = plot("survival", results=[result]).decode()
        self.assertIn("7: $\\frac{1}{0}$, $x^2$", text)

    def check_page(self, data):
        text = data.decode("utf-8")
        page = Page(text)
        self.assertLessEqual(page.tags, HTML_TAGS | SVG_TAGS)
        self.assertEqual(page.handlers, [])
        for address in page.addresses:
            self.assertRegex(address, r"^(#[\w-]+|data:image/png;base64,[\w+/=]*)$")
        self.assertIn("default-src 'none'", page.policy)
        self.assertLess(text.index("Content-Security-Policy"), text.index("<title>"))
        self.assertEqual(len(page.ids), len(set(page.ids)), "ids of two figures are equal")
        for reference in re.findall(r"url\(#([^)]*)\)|href=\"#([^\"]*)\"", text):
            self.assertIn("".join(reference), page.ids)
        return page

    def test_a_report_has_no_markup_of_participants_and_asks_nobody(self):
        for result in hostile_results():
            with self.subTest(name=result["name"][:20]):
                order = {"make": "report", "format": "html", "version": "0.1.0", "result": result,
                         "receipt": answers.receipt(), "strip": {"error": answers.HOSTILE[1]}}
                page = self.check_page(submission_report.page(
                    order, submission_report.numbers_of(result)))
                self.assertTrue(any("it said <script>alert(1)</script>" in one
                                    for one in page.texts))

    def test_a_report_shows_a_picture_and_nothing_that_is_none(self):
        result = answers.result(7, episodes=3)
        numbers = submission_report.numbers_of(result)
        for data, shown in ((PNG, True), ("PHN2Zy8+", False), ("not Base64", False)):
            page = self.check_page(submission_report.page(
                {"result": result, "version": "0", "receipt": {"error": "withheld"},
                 "strip": {"png": data}}, numbers))
            self.assertEqual("img" in page.tags, shown)

    def test_the_report_of_a_phase_has_no_markup_of_participants(self):
        results = hostile_results()
        order = {"make": "board-report", "format": "html", "version": "0.1.0",
                 **answers.board_order(results), "challenge": answers.HOSTILE[0],
                 "phase": {"title": answers.HOSTILE[1], "opens_at": None, "closes_at": None,
                           "seeds": {"kind": "public", "commitment": None}},
                 "results": [*results[:6], *({"submission": one["submission"], "team": one["team"],
                                              "name": one["name"], "error": answers.HOSTILE[2]}
                                             for one in results[6:])]}
        self.check_page(phase_report.page(order, phase_report.numbers_of(order)))

    def test_reports_of_what_is_withheld_or_empty_can_be_read(self):
        for result in (answers.withheld(7), {**answers.result(7), "episode_rows": [],
                                             "aggregate": None}, answers.result(7, detailed=False)):
            order = {"result": result, "version": "0", "receipt": {"error": "it has not ended"}}
            self.check_page(submission_report.page(order, submission_report.numbers_of(result)))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
