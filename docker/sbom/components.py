"""What the programs are made of: Debian's packages, by the libraries that the programs load and the
headers that the sources include, and PyPI's, by the lists that pin them."""

from __future__ import annotations

import dataclasses
import functools
import json
import pathlib
import re
import subprocess
import urllib.parse

DEADLINE_S = 120
# The parts whose sources become programs.
PARTS = ("protocol", "scoring", "sim", "server", "policies")
WHEEL_PARTS = ("protocol", "sim")  # of the extension in wheels
INCLUDE_FOLDERS = ("/usr/include", "/usr/include/x86_64-linux-gnu", "/usr/include/eigen3")
INCLUDE = re.compile(r"^\s*#\s*include\s*<([^>]+)>", re.M)
NEEDED = re.compile(r"\(NEEDED\).*\[([^\]]+)\]")
LOADED = re.compile(r"^\s*(\S+) => (not found|/\S+)", re.M)
PINNED = re.compile(r"^([\w.-]+)==([\w.]+) --hash=sha256:([0-9a-f]{64})$", re.M)
# Their headers are the interface to the C library and the kernel.
INTERFACES = {"libc6-dev", "linux-libc-dev"}
# Of these, only declarations: their libraries are opened where they are installed.
OPENED = {"libosmesa6-dev"}
LICENCES = pathlib.Path(__file__).with_name("licences.json")
DOC = pathlib.Path("/usr/share/doc")


class Trouble(Exception):
    """The bill can't be made here. One sentence says what, where and what to do."""


@dataclasses.dataclass(frozen=True)
class Component:
    kind: str  # debian, python or web
    name: str
    version: str  # empty: whatever is there when it is installed
    role: str  # relationship of SPDX; those that end in _OF go from it to the project
    licence: str = ""  # expression of SPDX; empty: it has none, so its own text stands for it
    origin: str = ""  # source package
    sha256: str = ""  # of the pinned download
    purl: str = ""
    comment: str = ""
    within: str = ""  # identifier of what it is a part of, if not of the project

    @property
    def identifier(self) -> str:
        return "SPDXRef-Package-" + self._plain

    @property
    def own_licence(self) -> str:
        return "LicenseRef-" + self._plain

    @property
    def licence_text(self) -> str:
        return (DOC / self.name / "copyright").read_text(encoding="utf-8", errors="replace")

    @property
    def _plain(self) -> str:
        words = "-".join(filter(None, (self.kind, self.name.replace("+", "x"), self.version)))
        return re.sub(r"[^A-Za-z0-9.-]+", "-", words)


def find(source: pathlib.Path, programs: pathlib.Path) -> list[Component]:
    """All of them, by kind and name. Trouble if a program needs a library that nobody accounts for."""
    found = debian(source, elf_files(programs), PARTS) + python(source) + parts_of_downloads(source)
    twice = {one.identifier for one in found if [two.identifier for two in found].count(one.identifier) > 1}
    if twice:
        raise Trouble(f"two packages have the same identifier: {', '.join(sorted(twice))}")
    return sorted(found, key=lambda one: (one.kind, one.name, one.version))


def in_wheel(source: pathlib.Path, extension: pathlib.Path, libraries: set[str]) -> list[Component]:
    """What a wheel of the Python package has in it besides MyoGrade: the packages of the `libraries` (names of
    files such as libzstd.so.1.5.4) that were copied beside the extension, and what is compiled into it."""
    loaded = {pathlib.Path(path).resolve().name: path for _, path in LOADED.findall(run("ldd", extension))
              if path != "not found"}
    strangers = sorted(libraries - set(loaded))
    if strangers:
        raise Trouble(f"{extension} does not load {', '.join(strangers)}, which the wheel brings; name the extension "
                      "that the wheel was made of")
    copied = set(owners_of({loaded[name] for name in libraries}).values())
    found = [one for one in debian(source, [extension], WHEEL_PARTS)
             if one.name in copied or one.role == "STATIC_LINK"]
    brought = {"nanobind"} | {"mujoco" for name in libraries if name.startswith("libmujoco.so.")}
    found += [one for one in python(source) if one.name in brought]
    return sorted(found, key=lambda one: (one.kind, one.name, one.version))


def run(*words: str | pathlib.Path, may_fail: bool = False) -> str:
    try:
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True,
                              timeout=DEADLINE_S, check=False, env={"LC_ALL": "C", "PATH": "/usr/bin:/bin"})
    except FileNotFoundError:
        raise Trouble(f"{words[0]} is not installed, so the packages behind the programs can't be told; "
                      "run this on Debian with binutils and dpkg") from None
    except subprocess.TimeoutExpired:
        raise Trouble(f"{words[0]} did not answer in {DEADLINE_S} s; try again when the host is less busy") from None
    if done.returncode != 0 and not may_fail:
        raise Trouble(f"{' '.join(map(str, words[:3]))} failed: {done.stderr.strip()[-300:]}")
    return done.stdout


@functools.cache
def licences() -> dict[str, dict[str, str]]:
    return json.loads(LICENCES.read_text(encoding="utf-8"))


# --- Debian's packages ----------------------------------------------------


def debian(source: pathlib.Path, files: list[pathlib.Path], parts: tuple[str, ...]) -> list[Component]:
    """Those of the libraries that these files load, and of the headers of the parts that they are made of."""
    needed = {name for file in files for name in NEEDED.findall(run("readelf", "-d", file))}
    loaded = {name: path for file in files for name, path in LOADED.findall(run("ldd", file))
              if not name.startswith("libmujoco.so.")}
    owners = owners_of({path for path in loaded.values() if path != "not found"})
    strangers = sorted(name for name, path in loaded.items() if path not in owners)
    if strangers:
        raise Trouble(f"no Debian package here has {', '.join(strangers)}, which the programs of "
                      f"{files[0].parent} load; install the package, or link the library of one")
    direct = {owners[path] for name, path in loaded.items() if name in needed}
    roles = {name: "DYNAMIC_LINK" if name in direct else "RUNTIME_DEPENDENCY_OF"
             for name in owners.values()}
    origins = {origin for _, _, origin, _ in facts(set(roles)).values()}
    for name, (_, _, origin, _) in facts(header_packages(source, parts)).items():
        # Nothing else of such a package is loaded, so what the programs use of it is in them.
        roles.setdefault(name, "BUILD_DEPENDENCY_OF" if origin in origins or name in OPENED
                         else "STATIC_LINK")
    return [of_debian(name, roles[name], *told) for name, told in facts(set(roles)).items()]


def of_debian(name: str, role: str, version: str, architecture: str, origin: str,
              origin_version: str) -> Component:
    quoted = urllib.parse.quote(version, safe=".~-_")
    return Component("debian", name, version, role, licences()["debian"].get(origin, ""),
                     f"{origin} {origin_version}",
                     purl=f"pkg:deb/debian/{urllib.parse.quote(name)}@{quoted}?arch={architecture}")


def elf_files(folder: pathlib.Path) -> list[pathlib.Path]:
    if not folder.is_dir():
        raise Trouble(f"{folder} is not a folder; name the one with the programs with --programs")
    found = []
    for path in sorted(folder.iterdir()):
        if path.is_file():
            with open(path, "rb") as stream:
                if stream.read(4) == b"\x7fELF":
                    found.append(path)
    if not found:
        raise Trouble(f"{folder} holds no program; build them first (./dev build)")
    return found


def header_packages(source: pathlib.Path, parts: tuple[str, ...]) -> set[str]:
    """The packages of the headers that the sources of these parts include."""
    headers = set()
    for part in parts:
        for path in (source / part).rglob("*"):
            if path.suffix in (".h", ".cc", ".c"):
                headers |= set(INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace")))
    paths = {f"{folder}/{header}" for header in headers for folder in INCLUDE_FOLDERS
             if (pathlib.Path(folder) / header).is_file()}
    return set(owners_of(paths).values()) - INTERFACES


def owners_of(paths: set[str]) -> dict[str, str]:
    """Path -> the package that has the file there."""
    if not paths:
        return {}
    # /lib leads to /usr/lib, and packages name either.
    asked = {path.removeprefix("/usr"): path for path in paths}
    names = sorted({name for short in asked for name in (short, "/usr" + short)})
    owners = {}
    for line in run("dpkg-query", "--search", *names, may_fail=True).splitlines():
        packages, separator, place = line.partition(": ")
        path = asked.get(place.removeprefix("/usr"))
        if separator and path and not packages.startswith("diversion "):
            owners[path] = packages.split(", ")[0].split(":")[0]
    return owners


def facts(names: set[str]) -> dict[str, tuple[str, str, str, str]]:
    """Name -> version, architecture, source package and its version, by name."""
    if not names:
        return {}
    line = "${Package}\\t${Version}\\t${Architecture}\\t${source:Package}\\t${source:Version}\\n"
    told = (row.split("\t") for row in run("dpkg-query", "-W", "-f", line, *sorted(names)).splitlines())
    return {name: (version, architecture, origin, origin_version)
            for name, version, architecture, origin, origin_version in told}


# --- PyPI's packages ------------------------------------------------------


def python(source: pathlib.Path) -> list[Component]:
    """The pinned ones that a release includes or fetches; what only builds or tests it is left out."""
    lists = [
        ("docker/wheels.txt", "RUNTIME_DEPENDENCY_OF", "fetched by the set-up"),
        ("docker/nanobind.txt", "STATIC_LINK", "in the Python package's environments; includes robin-map (MIT)"),
        ("policies/runtimes/python/requirements.txt", "RUNTIME_DEPENDENCY_OF", "in the runtime python"),
    ]
    lists += [(f"policies/runtimes/{file.parent.name}/requirements.txt", "OPTIONAL_DEPENDENCY_OF",
               f"in the runtime {file.parent.name}")
              for file in sorted((source / "policies/runtimes").glob("*/requirements.txt"))
              if file.parent.name != "python"]
    found: dict[tuple[str, str], Component] = {}
    for file, role, comment in lists:
        for name, version, digest in pinned(source / file):
            before = found.get((name, version))
            if before:
                found[name, version] = dataclasses.replace(before, comment=f"{before.comment}; {comment}")
            else:
                role_of_it = "DYNAMIC_LINK" if name == "mujoco" else role
                found[name, version] = Component(
                    "python", name, version, role_of_it, licence_of_python(name, source / file),
                    sha256=digest, purl=f"pkg:pypi/{name}@{version}", comment=comment)
    return list(found.values())


def pinned(file: pathlib.Path) -> list[tuple[str, str, str]]:
    """Name as PyPI writes it, version and SHA-256 of each wheel of a list."""
    found = PINNED.findall(file.read_text(encoding="utf-8"))
    if not found:
        raise Trouble(f"{file} pins no package; it should have lines NAME==VERSION --hash=sha256:...")
    return [(re.sub(r"[-_.]+", "-", name).lower(), version, digest) for name, version, digest in found]


def licence_of_python(name: str, file: pathlib.Path) -> str:
    licence = licences()["python"].get(name)
    if licence is None:
        raise Trouble(f"{LICENCES} has no licence of {name}, which {file} pins; add it")
    return licence


def parts_of_downloads(source: pathlib.Path) -> list[Component]:
    """What comes within another's package."""
    (_, version, digest), = pinned(source / "docker/three.txt")
    three = re.search(r"three\.js ([\d.]+)", (source / "docker/three.txt").read_text(encoding="utf-8"))
    if three is None:
        raise Trouble(f"{source}/docker/three.txt does not say which three.js its wheel brings; state it")
    models = next((one for one in python(source) if one.name == "myosuite"), None)
    if models is None:
        raise Trouble(f"{source}/docker/wheels.txt does not pin myosuite, which has the models; add it")
    return [
        Component("web", "three", three.group(1), "CONTAINS", "MIT", sha256=digest,
                  purl=f"pkg:npm/three@{three.group(1)}",
                  comment=f"modules in the web pages; the digest is that of the wheel nicegui {version}, "
                          "which brings them"),
        Component("python", "myo_sim", "", "CONTAINS", "Apache-2.0", within=models.identifier,
                  comment=f"the models of muscles and bones, as myosuite {models.version} brings them"),
    ]
