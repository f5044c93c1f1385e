"""Downloads the pinned packages into a cache folder: MuJoCo 2.2.2 as mujoco-2.2.2/{include,lib}, and the
challenge's models as myosuite-2.8.4. The grader's own set-up runs it as a program: models.py CACHE LIST. It therefore
imports from this package only when it is part of it."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from typing import Callable

if __package__:
    from .errors import MyogradeError, WrongUse
else:
    MyogradeError, WrongUse = RuntimeError, ValueError  # type: ignore[misc,assignment]

LIST = pathlib.Path(__file__).with_name("wheels.txt")
# Of the Python and the platform that the wheel of MuJoCo was made for; any Python may unpack it.
PLATFORM = ["--python-version", "3.10", "--platform", "manylinux2014_x86_64"]
PIP_DEADLINE_S = 1800
SYSTEM_CACHE = pathlib.Path("/var/cache/myograde")  # for all users; root's own
MODELS = "myosuite-2.8.4"
PINNED = re.compile(r"^(\w+)==([\w.]+) --hash=sha256:([0-9a-f]{64})$")


@dataclasses.dataclass(frozen=True)
class Pinned:
    name: str
    version: str
    sha256: str  # of the wheel

    @property
    def folder(self) -> str:
        return f"{self.name}-{self.version}"


@dataclasses.dataclass(frozen=True)
class Models:
    cache: pathlib.Path
    folders: list[pathlib.Path]  # one for each package
    fetched: list[str]  # the packages that were not there


def default_cache() -> pathlib.Path:
    """Where the programs of MyoGrade look by default: MYOGRADE_CACHE, or the user's own folder; the system's if only
    that has the models."""
    if os.environ.get("MYOGRADE_CACHE"):
        return pathlib.Path(os.environ["MYOGRADE_CACHE"])
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        return SYSTEM_CACHE
    own = _own_cache()
    if not (own / MODELS).is_dir() and (SYSTEM_CACHE / MODELS).is_dir():
        return SYSTEM_CACHE
    return own


def _own_cache() -> pathlib.Path:
    caches = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG specification has relative paths ignored.
    home = pathlib.Path(caches) if os.path.isabs(caches) else pathlib.Path.home() / ".cache"
    return home / "myograde"


def get_models(cache: str | os.PathLike[str] | None = None,
               tell: Callable[[str], None] = lambda sentence: None,
               pinned_list: pathlib.Path = LIST) -> Models:
    """Adds the missing pinned packages to the cache folder (default: default_cache()). Each appears under its name only
    when it is complete, so later and concurrent calls find it there. `tell` is called before a download. WrongUse if
    the folder can't be created, MyogradeError if pip can't download a package or its SHA-256 differs."""
    root = pathlib.Path(cache).expanduser() if cache is not None else default_cache()
    try:
        (root / "wheels").mkdir(parents=True, exist_ok=True)
        scratch = tempfile.TemporaryDirectory(prefix=".unpack.", dir=root)
    except OSError as error:
        raise WrongUse(f"{root}: can't be used as the cache folder ({error.strerror}); choose another with --cache or "
                       "MYOGRADE_CACHE") from error
    packages = read_list(pinned_list)
    with scratch as folder:
        fetched = [package.name for package in packages
                   if _provide(package, root, pathlib.Path(folder), tell)]
    return Models(root, [root / package.folder for package in packages], fetched)


def read_list(file: pathlib.Path = LIST) -> list[Pinned]:
    """The packages of a list in pip's format with one SHA-256 each."""
    lines = (line.strip() for line in file.read_text(encoding="utf-8").splitlines())
    return [Pinned(*match.groups()) for match in map(PINNED.match, lines) if match]


def _provide(package: Pinned, cache: pathlib.Path, scratch: pathlib.Path,
             tell: Callable[[str], None]) -> bool:
    """False if the package was there."""
    place = cache / package.folder
    if place.is_dir():
        return False
    wheel = _kept_wheel(package, cache / "wheels")
    if wheel is None:
        tell(f"Downloading {package.name} {package.version} ...")
        wheel = _download(package, scratch, cache / "wheels")
    unpacked = scratch / package.folder
    try:
        _unpack(package, wheel, unpacked)
    except (OSError, zipfile.BadZipFile) as error:
        raise MyogradeError(f"{wheel}: can't be unpacked into {cache} ({error}); make room there, "
                            "or name another folder") from error
    try:
        unpacked.rename(place)
    except OSError as error:
        if not place.is_dir():  # nobody else was faster
            raise MyogradeError(f"{place}: can't be created ({error.strerror})") from error
    return True


def _sha256(file: pathlib.Path) -> str:
    digest = hashlib.sha256()
    with open(file, "rb") as stream:
        for piece in iter(lambda: stream.read(1 << 20), b""):
            digest.update(piece)
    return digest.hexdigest()


def _kept_wheel(package: Pinned, folder: pathlib.Path) -> pathlib.Path | None:
    """An intact wheel of an earlier download."""
    for wheel in folder.glob(f"*-{package.version}-*.whl"):
        named = wheel.name.split("-")[0].lower() == package.name
        if named and _sha256(wheel) == package.sha256:
            return wheel
    return None


def _download(package: Pinned, scratch: pathlib.Path, wheels: pathlib.Path) -> pathlib.Path:
    requirements, target = scratch / "requirements.txt", scratch / f"wheel-{package.name}"
    requirements.write_text(f"{package.name}=={package.version} --hash=sha256:{package.sha256}\n")
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:",
               "--require-hashes", "--disable-pip-version-check", *PLATFORM, "-d", str(target),
               "-r", str(requirements)]
    what = f"{package.name} {package.version}"
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                              errors="replace", timeout=PIP_DEADLINE_S, check=False)
    except subprocess.TimeoutExpired:
        raise MyogradeError(f"pip did not download {what} in {PIP_DEADLINE_S // 60} minutes; check the "
                            "network and try again") from None
    found = list(target.glob("*.whl")) if done.returncode == 0 else []
    if not found:
        last = "\n".join((done.stdout + done.stderr).strip().splitlines()[-5:])
        raise MyogradeError(f"pip could not download {what}, or its SHA-256 differs; check the network "
                            f"and try again. The last lines of pip:\n{last}")
    kept = wheels / found[0].name
    os.replace(found[0], kept)
    kept.chmod(0o644)
    return kept


def _unpack(package: Pinned, wheel: pathlib.Path, folder: pathlib.Path) -> None:
    whole = folder.with_name(f"whole-{package.name}")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(whole)
    if package.name == "mujoco":
        (folder / "lib").mkdir(parents=True)
        library = f"libmujoco.so.{package.version}"
        (whole / "mujoco/include").rename(folder / "include")
        (whole / "mujoco" / library).rename(folder / "lib" / library)
    else:
        # Policy files and training logs of the package are not needed.
        shutil.rmtree(whole / "myosuite/agents", ignore_errors=True)
        whole.rename(folder)
    # Sandboxed processes run as other users.
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)


def main() -> int:
    try:
        get_models(sys.argv[1], lambda sentence: print(sentence, flush=True),
                   pathlib.Path(sys.argv[2]))
    except (MyogradeError, WrongUse) as error:
        print(f"error: {error}", file=sys.stderr)
        return 4
    return 0


if __name__ == "__main__":
    sys.exit(main())
