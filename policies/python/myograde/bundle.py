"""Copies the kit into a submission's folder."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import shutil
import tempfile

from .errors import MyogradeError, WrongUse

PACKAGE = pathlib.Path(__file__).resolve().parent


@dataclasses.dataclass(frozen=True)
class Bundle:
    folder: pathlib.Path  # the kit's, in the submission
    files: int
    replaced: bool  # an older kit was there
    has_manifest: bool  # the submission has a policy.json


def bundle(folder: str | os.PathLike[str]) -> Bundle:
    """Copies the kit into the submission's folder `folder`, as FOLDER/myograde, completely or not at all. An older kit
    is replaced. WrongUse if there is no such folder, or if it has something else of that name; MyogradeError if it
    can't be written."""
    root = pathlib.Path(folder)
    if not root.is_dir():
        raise WrongUse(f"{root}: there is no such folder; create the submission's folder first")
    place = root / "myograde"
    replaced = os.path.lexists(place)
    if replaced and (place.is_symlink() or not (place / "action_t.py").is_file()):
        raise WrongUse(f"{place}: already exists and is not a kit; move or rename it")
    try:
        files = _write(root, place)
    except OSError as error:
        raise MyogradeError(f"{place}: can't write the kit ({error.strerror}); nothing was "
                            "changed") from error
    return Bundle(place, files, replaced, (root / "policy.json").is_file())


def kit_files() -> list[pathlib.Path]:
    """The kit's files, relative to the package: what a policy imports, and no client."""
    top = [PACKAGE / "__init__.py", PACKAGE / "py.typed", PACKAGE / "messages.py"]
    types = sorted(PACKAGE.glob("*_t.py"))
    policy = sorted(file for file in (PACKAGE / "policy").iterdir()
                    if file.suffix in (".py", ".json"))
    return [file.relative_to(PACKAGE) for file in [*top, *types, *policy]]


def _write(root: pathlib.Path, place: pathlib.Path) -> int:
    with tempfile.TemporaryDirectory(prefix=".myograde-", dir=root) as scratch:
        new, old = pathlib.Path(scratch, "new"), pathlib.Path(scratch, "old")
        (new / "policy").mkdir(parents=True)
        files = kit_files()
        for file in files:
            shutil.copyfile(PACKAGE / file, new / file)
        if os.path.lexists(place):
            place.rename(old)
        try:
            new.rename(place)
        except OSError:
            if old.exists():
                old.rename(place)
            raise
    return len(files)
