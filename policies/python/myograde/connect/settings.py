"""The organiser's file; configs/EVALAI.md explains its keys."""

from __future__ import annotations

import json
import pathlib
from types import SimpleNamespace
from typing import Any

from ..client import Client
from ..client.server import check_token
from ..errors import WrongUse

NEEDED = object()
# The keys of each object: their type, and what holds without them.
FILE = {"evalai": (dict, None), "myograde": (dict, {}), "phases": (dict, NEEDED), "teams": (dict, {}),
        "poll_s": ((int, float), 10), "largest_bytes": (int, 5_000_000_000)}
EVALAI = {"server": (str, "https://eval.ai"), "challenge": (int, NEEDED), "queue": (str, NEEDED),
          "token_file": (str, NEEDED)}
MYOGRADE = {"server": (str, None), "token_file": (str, None), "ca_file": (str, None), "pages": (str, None)}
PHASE = {"phase": (str, None), "track": (str, None), "profile": (str, None), "episodes": (int, None),
         "splits": (dict, NEEDED)}


def _object(value: Any, where: str, shape: dict[str, Any]) -> SimpleNamespace:
    """The object's values under their keys. Keys that begin with // are comments."""
    if not isinstance(value, dict):
        raise WrongUse(f"{where}: must be an object")
    given = {key: entry for key, entry in value.items() if not key.startswith("//")}
    for key, entry in given.items():
        if key not in shape:
            raise WrongUse(f'{where}: unknown key "{key}"; known: {", ".join(shape)}')
        if not isinstance(entry, shape[key][0]) or isinstance(entry, bool):
            raise WrongUse(f'{where}: "{key}" has the wrong type; configs/EVALAI.md says what it takes')
    if missing := [key for key, (_, default) in shape.items() if default is NEEDED and key not in given]:
        raise WrongUse(f'{where}: "{missing[0]}" is missing')
    return SimpleNamespace(**{key: given.get(key, default) for key, (_, default) in shape.items()})


def _phase(value: Any, where: str) -> SimpleNamespace:
    phase = _object(value, where, PHASE)
    if (phase.phase is None) == (phase.track is None) or phase.phase and (phase.profile or phase.episodes):
        raise WrongUse(f'{where}: give "phase" alone, or "track" with "profile" and "episodes" as you need them')
    for split, columns in phase.splits.items():
        if not isinstance(columns, dict) or not all(isinstance(of, str) for of in columns.values()):
            raise WrongUse(f'{where}, splits, {split}: must say of each label what it shows, as a text')
    phase.where = where
    return phase


class Settings:
    """What the file says; relative paths in it are relative to its folder."""

    def __init__(self, file: str) -> None:
        self.file = pathlib.Path(file).absolute()
        try:
            content = json.loads(self.file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise WrongUse(f"{file}: can't be read as JSON ({getattr(error, 'strerror', error)})") from error
        top = _object(content, file, FILE)
        self.evalai = _object(top.evalai, f"{file}, evalai", EVALAI) if top.evalai else None
        self.myograde = _object(top.myograde, f"{file}, myograde", MYOGRADE)
        self.teams, self.poll_s, self.largest_bytes = top.teams, top.poll_s, top.largest_bytes
        if top.poll_s <= 0 or top.largest_bytes <= 0 or not all(isinstance(name, str) for name in top.teams.values()):
            raise WrongUse(f"{file}: poll_s and largest_bytes must be greater than 0, and teams' names be texts")
        self.phases = {pk: _phase(phase, f"{file}, phases, {pk}") for pk, phase in top.phases.items()}

    def secret(self, name: str) -> str:
        """What a token's file holds, read each time, so that it can be replaced."""
        try:
            token = (self.file.parent / name).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise WrongUse(f"{self.file.parent / name}: can't be read ({getattr(error, 'strerror', error)})") from error
        return check_token(token, str(self.file.parent / name))

    def client(self) -> Client:
        """The server's, as an organiser."""
        here = self.myograde
        made = Client(here.server, token=self.secret(here.token_file) if here.token_file else None,
                      ca_file=self.file.parent / here.ca_file if here.ca_file else None)
        made.require_organiser()
        return made

    def target(self, key: str) -> SimpleNamespace:
        """What the phase of another site stands for here."""
        if key not in self.phases:
            raise WrongUse(f"phase {key} is not graded here; tell the organisers, whose {self.file.name} lacks it")
        return self.phases[key]
