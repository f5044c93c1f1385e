#!/usr/bin/python3
"""Makes a C++ source of the files of the web pages.

embed.py FOLDER OUT.cc: each file of FOLDER has the address /web/NAME; index.html is also every page,
as pages.js in it decides by the address what to show. A name or type that is not known is a mistake;
exit status 1.
"""

import pathlib
import re
import sys

PAGES = ("/", "/board", "/queue", "/sign-in", "/submission", "/submit", "/team")
TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8",
         ".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml"}
CHUNK = 8000  # bytes of one string literal


def literals(text):
    """C++ string literals that together are `text`."""
    if ')web"' in text:
        raise SystemExit('embed.py: a file has )web", which ends a literal')
    pieces = [text[i:i + CHUNK] for i in range(0, len(text), CHUNK)]
    return "\n".join(f'R"web({piece})web"' for piece in pieces)


def entries(folder):
    for file in sorted(folder.iterdir()):
        if not re.fullmatch(r"[a-z0-9_-]+\.[a-z]+", file.name) or file.suffix not in TYPES:
            raise SystemExit(f"embed.py: {file.name}: such a name or type has no address")
        text = file.read_text(encoding="utf-8")
        for path in PAGES if file.name == "index.html" else (f"/web/{file.name}",):
            yield path, TYPES[file.suffix], text


def main():
    folder, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    constants, rows = [], []
    for number, (path, kind, text) in enumerate(sorted(entries(folder))):
        constants.append(f"constexpr std::string_view kText{number} =\n{literals(text)};\n")
        rows.append(f'    {{"{path}", "{kind}", kText{number}}},\n')
    out.write_text(
        '#include "server/web/files.h"\n\n#include <array>\n\nnamespace myograde::server {\n'
        "namespace {\n\n" + "\n".join(constants)
        + "\nconstexpr auto kFiles = std::to_array<WebFile>({\n" + "".join(rows)
        + "});\n\n}  // namespace\n\nstd::span<const WebFile> WebFiles() { return kFiles; }\n\n"
        "}  // namespace myograde::server\n", encoding="utf-8")


if __name__ == "__main__":
    main()
