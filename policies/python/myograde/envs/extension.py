"""The extension module _env, and what it needs on this machine: the models in the cache folder, and
maths functions that every host has."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import subprocess
import sys
from typing import Any

from ..errors import MyogradeError, WrongUse
from ..models import MODELS, default_cache

HERE = pathlib.Path(__file__).resolve().parent
TRACKS = HERE / "tracks"  # the configs of the grader's tracks
REFERENCE = HERE / "reference"  # the log of an episode of each track
NOT_BUILT = HERE / "not_built.txt"  # why this installation has no environments, if the build knew
COMPILE_DEADLINE_S = 600


@dataclasses.dataclass(frozen=True)
class TrackSeeds:
    """What a track's config says about its episodes."""

    profile: str
    seeds: tuple[int, ...]  # of the ranked episodes, in order
    policy_seeds: tuple[int, ...]  # what a policy is told in each of them
    practice_seeds: tuple[int, ...]
    max_steps: int  # control steps of the longest episode
    config_hash: str  # the config's SHA-256, as in results


@dataclasses.dataclass(frozen=True)
class Replayed:
    """How an episode's log compared with this host's simulation."""

    equal: bool
    steps: int  # that were compared and are equal
    detail: str  # if not equal: a sentence


def load() -> Any:
    """The extension module. MyogradeError if this installation has none."""
    try:
        from .. import _env
    except ImportError as error:
        if NOT_BUILT.is_file():
            raise MyogradeError(NOT_BUILT.read_text()) from error
        raise MyogradeError(
            f"this installation of myograde has the kit and the client but no environments: {error}. They are in the "
            "wheels that ./dev wheel builds for CPython 3.9 to 3.12 on "
            "Linux (x86-64); building them takes a C++ compiler and the grader's packages") from error
    return _env


def exact() -> bool:
    """Whether this process computes the same as a grader, to the bit: when a process starts, the C library chooses its
    maths functions by the processor, unless environment variables fix them. `python -m myograde run SCRIPT` starts a
    script so; `python -m myograde check` tests it."""
    return load().maths_are_pinned()


def require_exact() -> None:
    """WrongUse unless exact()."""
    if not exact():
        raise WrongUse("this process was not started with the grader's maths functions, so its digests may differ "
                       "from a server's; start it with: python -m myograde run "
                       + (sys.argv[0] if sys.argv and sys.argv[0] not in ("", "-c") else "SCRIPT"))


def pinned_environment() -> dict[str, str]:
    """The variables of a process whose maths is the grader's."""
    extension = load()
    # Other tunables stay; of a repeated one, the C library takes the last.
    others = [setting for setting in os.environ.get(extension.PINNED_VARIABLE, "").split(":")
              if setting and not setting.startswith("glibc.cpu.hwcaps=")]
    return {**os.environ, extension.PINNED_VARIABLE: ":".join([*others, extension.PINNED_VALUE])}


def provide_models(cache: str | os.PathLike[str] | None = None) -> str:
    """The cache folder, with compiled models in it; they are compiled on the first use, in a process
    whose maths is the grader's. MyogradeError says what is missing."""
    extension = load()
    folder = pathlib.Path(cache).expanduser() if cache is not None else default_cache()
    if not extension.models_are_compiled(str(folder)):
        if not (folder / MODELS).is_dir():
            raise MyogradeError(f"{folder}: has no models yet; download them with: python -m myograde get-models "
                                f"--cache {folder}")
        compile_models(folder)
    return str(folder)


def compile_models(folder: pathlib.Path) -> None:
    """Compiles the models in a cache folder, also for graders on this host."""
    script = "import sys; from myograde import _env; _env.compile_models(sys.argv[1])"
    variables = pinned_environment()
    variables["PYTHONPATH"] = os.pathsep.join(
        [str(HERE.parents[1]), *filter(None, [variables.get("PYTHONPATH")])])
    try:
        done = subprocess.run([sys.executable, "-B", "-c", script, str(folder)], env=variables,
                              stdin=subprocess.DEVNULL, capture_output=True, text=True,
                              errors="replace", timeout=COMPILE_DEADLINE_S, check=False)
    except subprocess.TimeoutExpired:
        raise MyogradeError(f"compiling the models in {folder} took more than "
                            f"{COMPILE_DEADLINE_S // 60} minutes; try again") from None
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        raise MyogradeError(f"{folder}: can't compile the models there: {last[0]}; choose another cache folder with "
                            "MYOGRADE_CACHE, or download the models again")


def tracks_folder() -> str:
    """The folder of the track configs."""
    if not TRACKS.is_dir():
        raise MyogradeError(f"{TRACKS}: is missing; reinstall myograde")
    return str(TRACKS)


def seeds(track: str, profile: str = "",
          config: str | os.PathLike[str] | None = None) -> TrackSeeds:
    """Of a track such as "locomotion", in a rules profile (default: the config's default), or of an
    organiser's config file in its place. WrongUse if there is no such track or profile, or the file
    is wrong."""
    try:
        described = load().describe_config(tracks_folder(), track, profile, path_or_none(config))
    except (ValueError, FileNotFoundError) as error:
        raise WrongUse(str(error)) from error
    except TypeError as error:
        raise WrongUse(f"track={track!r}, profile={profile!r} and config={config!r} can't be used; the "
                       "first two must be text, and the last a path or None") from error
    return TrackSeeds(described["profile"], tuple(described["seeds"]),
                      tuple(described["policy_seeds"]), tuple(described["practice_seeds"]),
                      described["max_steps"], described["hash"])


def replay(log: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> Replayed:
    """Plays an episode's log from a server (`myograde episode log`) here, and compares each observation and
    state. MyogradeError if it is not a log, or a damaged one."""
    try:
        record = load().replay(str(log), provide_models(cache))
    except (ValueError, FileNotFoundError, RuntimeError) as error:
        raise MyogradeError(str(error)) from error
    return Replayed(record["equal"], record["steps"], record["detail"])


def path_or_none(path: str | os.PathLike[str] | None) -> str:
    """An optional file as the extension takes it: an absolute path, or "" for none."""
    return "" if path is None else str(pathlib.Path(path).expanduser().absolute())
