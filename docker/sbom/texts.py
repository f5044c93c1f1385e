"""The texts of licences: of Debian's packages from /usr/share/doc, of PyPI's from what their wheels state."""

from __future__ import annotations

import pathlib
import re
import shutil
import zipfile

from components import DOC, Component, Trouble

FOLDERS = ("debian", "common-licenses", "python", "web")
COMMON = pathlib.Path("/usr/share/common-licenses")
COMMON_NAME = re.compile(r"/usr/share/common-licenses/([A-Za-z][A-Za-z0-9.-]*[A-Za-z0-9])")
LICENCE_FILE = re.compile(r"(LICEN[CS]E|COPYING|NOTICE|AUTHORS)", re.I)
# Where the text of one is that has no metadata of its own, below the cache folder.
ELSEWHERE = {"myo_sim": "myosuite-*/myosuite/simhive/myo_sim/LICENSE"}


def write(found: list[Component], target: pathlib.Path, cache: pathlib.Path | None, source: pathlib.Path,
          remark: str = "") -> list[str]:
    """Fills `target` anew with the texts and NOTICE.txt, which lists them and begins with the remark. Returns the names
    of the components without a text here; Trouble if a release would lack one."""
    for folder in FOLDERS:
        shutil.rmtree(target / folder, ignore_errors=True)
    target.mkdir(parents=True, exist_ok=True)
    lacking, lines = [], []  # of what is only in runtimes that few servers have
    for component in found:
        names = collect(component, target, cache, source)
        if not names and component.role != "OPTIONAL_DEPENDENCY_OF":
            raise Trouble(f"there is no licence text of {component.name} here; "
                          + ("install its package with its documents" if component.kind == "debian"
                             else "./dev setup fills the cache, and --cache or MYOGRADE_CACHE names it"))
        if not names:
            lacking.append(component.name)
        licence = component.licence or "see its text"
        lines.append(f"{component.name} {component.version}".strip() + f": {licence}\n"
                     + "".join(f"  {name}\n" for name in names))
    (target / "NOTICE.txt").write_text(
        "MyoGrade is under the Apache License 2.0. It uses what follows; below each name are the files with "
        f"its licences.\n{remark}\n" + "".join(lines), encoding="utf-8")
    return lacking


def collect(component: Component, target: pathlib.Path, cache: pathlib.Path | None,
            source: pathlib.Path) -> list[str]:
    """Copies the texts of one component below `target`. Returns their names; none if no text is here."""
    if component.kind == "debian":
        return _of_debian(component.name, target)
    if component.kind == "web":
        # Debian's packages carry the same sentence for the same files.
        text = (source / "docker/debian/copyright").read_bytes()
        return [_put(target, f"web/{component.name}/copyright", text)]
    name = "-".join(filter(None, (component.name, component.version)))
    found = _of_python(component, cache) if cache else {}
    return [_put(target, f"python/{name}/{file}", found[file]) for file in sorted(found)]


def _put(target: pathlib.Path, name: str, text: bytes) -> str:
    path = target / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text)
    return name


def _of_debian(name: str, target: pathlib.Path) -> list[str]:
    file = DOC / name / "copyright"
    if not file.is_file():
        return []
    text = file.read_bytes()
    names = [_put(target, f"debian/{name}/copyright", text)]
    for common in sorted(set(COMMON_NAME.findall(text.decode(errors="replace")))):
        if (COMMON / common).is_file():
            names.append(_put(target, f"common-licenses/{common}", (COMMON / common).read_bytes()))
    return names


def _of_python(component: Component, cache: pathlib.Path) -> dict[str, bytes]:
    """Name -> text, from the cache: unpacked packages and runtimes first, then wheels."""
    if component.name in ELSEWHERE:
        return {path.name: path.read_bytes() for path in sorted(cache.glob(ELSEWHERE[component.name]))[:1]}
    for folder in sorted([*cache.glob("*/*.dist-info"), *cache.glob("runtimes/*/*.dist-info")]):
        if _fits(folder.name, component):
            found = {path.relative_to(folder).as_posix(): path.read_bytes()
                     for path in folder.rglob("*") if path.is_file() and LICENCE_FILE.search(path.name)}
            if found:
                return found
    for wheel in sorted(cache.glob(f"wheels/*-{component.version}-*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            found = {}
            for name in archive.namelist():
                folder, _, rest = name.partition("/")
                if rest and _fits(folder, component) and LICENCE_FILE.search(pathlib.Path(name).name):
                    found[rest] = archive.read(name)
            if found:
                return found
    return {}


def _fits(folder: str, component: Component) -> bool:
    """Whether NAME-VERSION.dist-info is the component's."""
    plain = re.sub(r"[-_.]+", "-", folder.removesuffix(".dist-info")).lower()
    return folder.endswith(".dist-info") and plain == re.sub(
        r"[-_.]+", "-", f"{component.name}-{component.version}").lower()
