#!/usr/bin/python3
"""Makes a C++ source of the files of the web pages.

embed.py FOLDER THREE OUT.cc: each file of FOLDER has the address /web/NAME; index.html is also every
page, as main.js decides by the address what to show. THREE is the folder with the modules of three.js,
whose imports are changed to the addresses that they have here: pages may have no import map, which
would be an inline script. Each file is there as it is and, if that is smaller, compressed by gzip. A
name, type or import that is not known is a mistake; exit status 1.
"""

import gzip
import pathlib
import re
import sys

PAGES = ("/", "/board", "/queue", "/replay", "/sign-in", "/submission", "/submit", "/team")
TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8",
         ".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml"}
# What three.js's modules are called here, and by what they import each other.
THREE = {"three.module.js": "three.js", "OrbitControls.js": "three_orbit_controls.js",
         "GLTFLoader.js": "three_gltf_loader.js", "BufferGeometryUtils.js": "three_geometry.js"}
IMPORTS = {"three": "three.js", "BufferGeometryUtils": "three_geometry.js"}
FROM = re.compile(r"""^(import .*|\}) from '([^']+)';$""", re.MULTILINE)
CHUNK = 8000  # bytes of one string literal


def escaped(byte):
    """A byte as it stands in a C++ string literal."""
    return chr(byte) if 32 <= byte < 127 and byte not in b'"\\?' else f"\\{byte:03o}"


def literals(data):
    """C++ string literals that together are `data`."""
    pieces = [data[i:i + CHUNK] for i in range(0, len(data), CHUNK)]
    return "\n".join('"' + "".join(map(escaped, piece)) + '"' for piece in pieces) + "sv"


def with_own_imports(file):
    """The text of a module of three.js, importing the others by their addresses here."""
    def own(found):
        if found[2] not in IMPORTS:
            raise SystemExit(f"embed.py: {file}: no address is known for the import '{found[2]}'")
        return f"{found[1]} from './{IMPORTS[found[2]]}';"
    text = file.read_text(encoding="utf-8")
    if re.search(r"\bimport\(", text):
        raise SystemExit(f"embed.py: {file}: it imports while it runs, by an address that is not known")
    return FROM.sub(own, text)


def entries(folder, three):
    """(address, type, text) of each file."""
    for file in folder.iterdir():
        if not re.fullmatch(r"[a-z0-9_-]+\.[a-z]+", file.name) or file.suffix not in TYPES:
            raise SystemExit(f"embed.py: {file.name}: such a name or type has no address")
        if file.name in THREE.values():
            raise SystemExit(f"embed.py: {file.name}: a module of three.js has this name")
        text = file.read_text(encoding="utf-8")
        for path in PAGES if file.name == "index.html" else (f"/web/{file.name}",):
            yield path, TYPES[file.suffix], text
    for name, own in THREE.items():
        yield f"/web/{own}", TYPES[".js"], with_own_imports(three / name)


def main():
    folder, three, out = (pathlib.Path(argument) for argument in sys.argv[1:])
    constants, rows, known = [], [], {}
    for path, kind, text in sorted(entries(folder, three)):
        number = known.setdefault(text, len(known))
        if number == len(constants):
            plain = text.encode()
            packed = gzip.compress(plain, 9, mtime=0)
            constants.append(f"constexpr std::string_view kText{number} =\n{literals(plain)};\n"
                             f"constexpr std::string_view kPacked{number} =\n"
                             f"{literals(packed if len(packed) < len(plain) else b'')};\n")
        rows.append(f'    {{"{path}", "{kind}", kText{number}, kPacked{number}}},\n')
    out.write_text(
        '#include "server/web/files.h"\n\n#include <array>\n\nnamespace myograde::server {\n'
        "namespace {\n\nusing namespace std::string_view_literals;\n\n" + "\n".join(constants)
        + "\nconstexpr auto kFiles = std::to_array<WebFile>({\n" + "".join(rows)
        + "});\n\n}  // namespace\n\nstd::span<const WebFile> WebFiles() { return kFiles; }\n\n"
        "}  // namespace myograde::server\n", encoding="utf-8")


if __name__ == "__main__":
    main()
