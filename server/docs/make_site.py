#!/usr/bin/env python3
"""Makes the documents' site of the pages in the folders: make_site.py OUT VERSION --program FILE [--source DIR]

site.json says which page is for whom, where each reader starts, what titles some pages have here, and what placeholders
stand for; every page of the tree must be there. The site is OUT/VERSION. A path in backquotes that names another page
becomes a link with that page's title. COMMANDS is made of what the program myograde prints for --help, and ADDRESSES of the
API's OpenAPI document. Needs the MkDocs of docker/docs.txt beside the interpreter that runs this.
Exit status: 0 made, 1 a page or a link is wrong, 2 wrong use.
Example: make_site.py build/docs 1.0 --program build/release/bin/myograde
"""

import argparse
import html
import itertools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from help import helps_below

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "api/openapi"))
from addresses import Page  # noqa: E402
from bundle import bundle  # noqa: E402

FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
PAGE_NAME = re.compile(r"(?<!\[)`([\w./-]+\.md)`(?!\])")
HEADING = re.compile(r"^# (.+)$", re.MULTILINE)
# The root page's, which the site leaves out: whoever reads it there has the pages themselves.
PICTURE = re.compile(r"^!\[[^\]]*\]\([^)]*\)\n\n?", re.MULTILINE)
ITEM = re.compile(r"([-*]|\d+\.) ")
ROW = re.compile(r"^\|.*$", re.MULTILINE)
CODE = re.compile(r"<code>([^<]+)</code>")
# Longer words may be broken, so that they fit on a narrow screen.
LONGEST_WORD = 30
# As GitHub shows the root's page, it is the tour; the site's first page is a list of all.
ROOT_PAGE, TOUR = "README.md", "tour.md"
# Where the list of commands belongs, and its page.
CLI_PAGE, COMMANDS = "server/cli/README.md", "commands.md"
ADDRESSES = "server/api/ADDRESSES.md"


def pages_of(source):
    """All pages of the tree, without what is built."""
    found = set()
    for folder, names, files in os.walk(source):
        names[:] = [name for name in names if name not in ("build", ".git")]
        found |= {pathlib.Path(folder, file).relative_to(source).as_posix()
                  for file in files if file.endswith(".md")}
    return found


def place_of(page):
    return TOUR if page == ROOT_PAGE else page


def linked(page, text, titles):
    """The text with links where it names other pages, by their path from its folder or from the root."""
    folder = os.path.dirname(page)

    def link(match):
        for start in (folder, ""):
            target = os.path.normpath(os.path.join(start, match[1]))
            if target == page:
                return match[0]
            if target in titles:
                return f"[{titles[target]}]({os.path.relpath(place_of(target), folder or '.')})"
        raise SystemExit(f"make_site.py: {page}: there is no page {match[1]}")

    parts = FENCE.split(text)
    return "".join(part if i % 2 else PAGE_NAME.sub(link, part) for i, part in enumerate(parts))


def title_of(page, text):
    match = HEADING.search(text)
    if match is None:
        raise SystemExit(f"make_site.py: {page}: it has no heading of the first level")
    return match[1].replace("`", "")


def check_lists(page, text):
    """Ends the program at a list that MkDocs would take for a part of the paragraph above it."""
    for part in FENCE.split(text)[::2]:
        for before, line in itertools.pairwise(part.splitlines()):
            if ITEM.match(line) and before and not before.startswith((" ", "#")) and not ITEM.match(before):
                raise SystemExit(f"make_site.py: {page}: a list needs an empty line before it: {line}")


def with_pipes(text):
    """The text with the pipes in code of tables as MkDocs reads them: without the backslash that GitHub needs."""
    return ROW.sub(lambda row: re.sub(r"`[^`]*`", lambda code: code[0].replace("\\|", "|"), row[0]), text)


def keep_words(page):
    """Marks the words of code in the made `page`, which browsers would break at hyphens and in narrow columns."""
    def mark(match):
        return "<code>" + re.sub(r"\S+", lambda word: f'<span class="word">{word[0]}</span>' if len(
            html.unescape(word[0])) <= LONGEST_WORD else word[0], match[1]) + "</code>"

    text = page.read_text(encoding="utf-8")
    page.write_text("".join(part if i % 2 else CODE.sub(mark, part) for i, part in enumerate(
        re.split(r"(<pre.*?</pre>)", text, flags=re.DOTALL))), encoding="utf-8")


def commands_page(program):
    """All verbs of the program with their arguments and options, as Markdown."""
    def row(words):
        return "| " + " | ".join(word.replace("|", "\\|") for word in words) + " |"

    lines = ["# Commands", "", "What `myograde VERB --help` prints, for every verb.", ""]
    for words, shown in helps_below(program):
        lines += [f"{'#' * (1 + len(words))} `{' '.join(words)}`", "",
                  html.escape(shown.summary, quote=False) + ".", "", "```sh", shown.usage, "```", ""]
        entries = [entry for section in ("Positionals", "Options") for entry in shown.entries(section)
                   if not entry[0].startswith("-h,")]
        if entries:
            lines += [row(["argument or option", "meaning"]), "|---|---|"]
            lines += [row([f"`{name}`", html.escape(meaning, quote=False)]) for name, meaning in entries] + [""]
        example = shown.sections.get("Example")
        if example:
            lines += ["Example:", "", "```sh", *(line.strip() for line in example), "```", ""]
    return "\n".join(lines) + "\n"


def collect(source, work, version, program):
    """Writes pages and mkdocs.yml (as JSON, which is YAML) into the folder `work`."""
    site = json.loads((HERE / "site.json").read_text(encoding="utf-8"))
    audiences = site["audiences"]
    listed = [page for pages in audiences.values() for page in pages]
    known = pages_of(source)
    for page in sorted(known ^ set(listed)):
        raise SystemExit(f"make_site.py: {page}: " + (
            "say in server/docs/site.json whom it is for" if page in known else
            "server/docs/site.json names it, and there is no such page"))
    if len(listed) != len(set(listed)):
        raise SystemExit("make_site.py: server/docs/site.json names a page twice")
    texts = {page: (source / page).read_text(encoding="utf-8") for page in listed}
    texts[ADDRESSES] = Page(bundle(version)).text(texts[ADDRESSES].split("\n## ")[0])
    titles = {page: site["titles"].get(page) or title_of(page, text) for page, text in texts.items()}
    nav = [{"All pages": "index.md"}]
    first = [f"# MyoGrade {version}\n", linked("index.md", site["introduction"], titles) + "\n"]
    first += [f"- **{audience}**: {linked('index.md', site['starts'][audience], titles)}" for audience in audiences]
    for audience, pages in audiences.items():
        entries = []
        first.append(f"\n## {audience}\n")
        for page in pages:
            target = work / "pages" / place_of(page)
            target.parent.mkdir(parents=True, exist_ok=True)
            check_lists(page, texts[page])
            text = PICTURE.sub("", with_pipes(linked(page, texts[page], titles)))
            if page in site["titles"]:
                text = HEADING.sub(lambda _, title=titles[page]: f"# {title}", text, count=1)
            for placeholder, example in site["examples"].items():
                text = text.replace(placeholder, example)
            target.write_text(text, encoding="utf-8")
            entries.append({titles[page]: place_of(page)})
            first.append(f"- [{titles[page]}]({place_of(page)})")
            if page == CLI_PAGE:
                (work / "pages" / COMMANDS).write_text(commands_page(program), encoding="utf-8")
                entries.append({"Commands": COMMANDS})
                first.append(f"- [Commands]({COMMANDS})")
        nav.append({audience: entries})
    (work / "pages/index.md").write_text("\n".join(first) + "\n", encoding="utf-8")
    config = {"site_name": "MyoGrade", "docs_dir": "pages", "site_dir": "site", "nav": nav,
              "use_directory_urls": False, "markdown_extensions": [{"toc": {"permalink": False}}],
              "plugins": ["search"], "extra": {"version": version},
              # The index alone: theme/search.js reads it, as the generator's own script writes markup.
              "theme": {"name": None, "custom_dir": str(HERE / "theme"), "search_index_only": True},
              "validation": {"omitted_files": "warn", "unrecognized_links": "warn", "anchors": "warn",
                             "absolute_links": "ignore"}}
    (work / "mkdocs.yml").write_text(json.dumps(config, indent=1), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("version")
    parser.add_argument("--program", type=pathlib.Path, required=True, help="myograde, as it was built")
    parser.add_argument("--source", type=pathlib.Path, default=HERE.parents[1])
    options = parser.parse_args()
    if not re.fullmatch(r"\d+\.\d+", options.version):
        parser.error(f"{options.version} is not a version such as 1.0")
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        collect(options.source.resolve(), work, options.version, options.program.resolve())
        done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict"], cwd=work,
                              capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.stderr.write(done.stdout + done.stderr)
            return 1
        # What only search engines read.
        for name in ("sitemap.xml", "sitemap.xml.gz"):
            (work / "site" / name).unlink(missing_ok=True)
        for page in (work / "site").rglob("*.html"):
            keep_words(page)
        target = options.out / options.version
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(work / "site", target)
    print(f"{target}: {sum(1 for _ in target.rglob('*.html'))} pages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
