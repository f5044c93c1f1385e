"""Cases 47, 48, 73, 74 and 105: what must be rejected at submission, with a reason, before
anything of it runs. 85 and 86 are in crowds.py, 106 is in hidden.py."""

import contextlib
import dataclasses
import json
import os
import pathlib
import random
import shutil
import threading
from typing import Callable

import archives
import crowds
import hidden
from support.client import ApiError

WRONG_USE = 2
NO_DAEMON = (2, 4)  # a daemon that does not start
NUMBERS = {"zero": "0", "negative": "-1", "large": "1e18", "nan": "NaN", "infinite": "Infinity",
           "text": '"many"', "none": "null", "list": "[1]"}


@dataclasses.dataclass(frozen=True)
class SubmissionCase:
    """A case whose `run`, given the suite, returns its mistakes."""

    number: int
    title: str
    run: Callable
    quick: bool = True  # belongs to the quick form of the suite


def _refused(name, done, statuses=(WRONG_USE,)):
    """Mistakes of a verb that should have rejected its input."""
    words = done.stderr.decode(errors="replace").strip()
    if done.returncode not in statuses:
        yield f"{name}: exit status {done.returncode}: {words[:200]}"
    if not words or done.stdout.strip():
        yield f"{name}: no reason was given"
    if any(ord(c) < 32 and c not in "\n\t" for c in words):
        yield f"{name}: control characters in the reason"


def _api_refuses(name, host, path, body, kind="application/json"):
    try:
        answer = host.post(path, body, kind)
    except ApiError as error:
        if not 400 <= error.status < 500 or not error.answer["error"]["message"]:
            yield f"{name}: {error}"
    else:
        yield f"{name}: accepted as {answer}"


def _count(host):
    return (len(host.get("/v1/submissions?limit=1000")["submissions"]),
            len(os.listdir(host.data / "artefacts")))


def _escaped(host):
    places = [pathlib.Path("/tmp"), pathlib.Path("/"), host.root, host.data,
              host.data / "artefacts", host.data / "spool", host.root.parent]
    return [f"{place / archives.ESCAPED} was written" for place in places
            if (place / archives.ESCAPED).exists()]


def _accepts_good(host, folder):
    """Rejections by a daemon that rejects everything would prove nothing."""
    for name, content in archives.good().items():
        (folder / name).write_bytes(content)
        try:
            submission = host.submit(folder / name, "rt", "Archives", 1)
        except RuntimeError as error:
            yield f"{name}, which is fine, was refused: {error}"
        else:
            if host.wait(submission, 60) is None:
                yield f"{name} did not end"


def run_archives(suite):
    host = suite.host
    folder = host.root / "archives"
    folder.mkdir(exist_ok=True)
    mistakes = list(_accepts_good(host, folder))
    before = _count(host)
    for name, content in archives.bad().items():
        (folder / name).write_bytes(content)
        done = host.verb("submit", folder / name, "--track", "rt", "--team", "Archives")
        mistakes += _refused(name, done)
        if ".tar" in name:
            mistakes += _api_refuses(f"{name} by HTTP", host, "/v1/artefacts", content,
                                     "application/x-tar")
        (folder / name).unlink()
    # The concurrent honest submission adds rows, but no new artefact.
    if _count(host)[1] != before[1]:
        mistakes.append("a refused archive left something among the artefacts")
    shutil.rmtree(folder)
    return mistakes + _escaped(host)


def _manifests():
    """Texts of policy.json that request what is not allowed."""
    start = '{"name": "m", "command": ["./run"], '
    texts = {f"limit {name}": f'{start}"memory_bytes": {value}}}'
             for name, value in NUMBERS.items()}
    texts |= {f"limits {name}": f'{start}"limits": {{"cpu_s": {value}}}}}'
              for name, value in NUMBERS.items()}
    texts |= {
        "unknown key": start + '"colour": "red"}',
        "key twice": start + '"name": "other"}',
        "empty": "", "no object": "[]", "cut": start, "deep": "[" * 20000,
        "large": start + '"x": "' + "y" * 100000 + '"}',
        "no command": '{"name": "m"}', "empty command": '{"name": "m", "command": []}',
        "number for command": '{"name": "m", "command": 7}',
        "command outside": '{"name": "m", "command": ["../../bin/sh"]}',
        "NUL in command": '{"name": "m", "command": ["./run\\u0000x"]}',
        "many words": '{"name": "m", "command": ["./run"' + ', "x"' * 1000 + "]}",
        "long name": '{"name": "' + "n" * 100 + '", "command": ["./run"]}',
        "odd name": '{"name": "\\u001b[2J", "command": ["./run"]}',
        "unknown runtime": start + '"runtimes": ["../../etc"]}',
        "runtime that is a number": start + '"runtimes": [1e18]}',
    }
    return texts


def _bad_manifests(host, folder):
    run = folder / "run"
    run.write_text("#!/bin/sh\n")
    run.chmod(0o755)
    for name, text in _manifests().items():
        (folder / "policy.json").write_text(text)
        yield from _refused(f"manifest with {name}",
                            host.verb("submit", folder, "--track", "rt", "--team", "Manifests"))


def _bad_requests(host, policy):
    for name, value in {**NUMBERS, "huge": "99999999999999999999"}.items():
        words = value.strip('"')
        yield from _refused(f"--episodes {name}",
                            host.verb("submit", policy, "--track", "rt", "--team", "Requests",
                                     f"--episodes={words}"))
        body = ('{"artefact": "%s", "team": "Requests", "track": "rt", "episodes": %s}'
                % ("0" * 64, value))
        yield from _api_refuses(f"episodes {name} by HTTP", host, "/v1/submissions", body)
        seeds = host.root / "seeds.json"
        seeds.write_text(f"[1, {value if name != 'zero' else '1'}]")
        if name not in ("large",):  # a whole number that a seed may be, but written as a fraction
            yield from _refused(f"seed {name}",
                                host.verb("submit", policy, "--track", "rt", "--team", "Requests",
                                         "--seeds", seeds))


def _bad_tracks(host):
    """A track with an invalid limit: no verb accepts it, and no daemon starts with it."""
    configs = host.root / "bad-configs"
    for key in ("memory_bytes", "tasks", "step_s", "lease_wall_s", "scratch_files", "no_such"):
        for name, value in NUMBERS.items():
            if (key, name) == ("no_such", "none"):
                continue  # null removes a key, and this one does not exist
            shutil.copytree(host.configs, configs)
            (configs / "tracks" / "bad.json").write_text(
                '{"extends": "locomotion", "budgets": {"%s": %s}}' % (key, value))
            yield from _refused(f"{key} {name}", host.verb("spec", "--track", "bad", "--configs",
                                                          configs))
            if name == "zero":
                yield from _refused(f"serve with {key} {name}",
                                    host.verb("serve", "--data", host.root / "bad-data",
                                             "--configs", configs), NO_DAEMON)
            shutil.rmtree(configs)


def run_manifests(suite):
    host = suite.host
    folder = host.root / "manifest"
    folder.mkdir(exist_ok=True)
    if host.user is not None:
        os.chown(folder, host.user, host.user)
    policy = suite.build / "policies" / "zero"
    before = _count(host)[1]
    mistakes = [*_bad_manifests(host, folder), *_bad_requests(host, policy), *_bad_tracks(host)]
    if _count(host)[1] > before + 1:
        mistakes.append("a refused manifest left something among the artefacts")
    if json.loads(host.verb("status", "--json").stdout)["daemon"]["status"] != "ok":
        mistakes.append("the daemon is not well")
    shutil.rmtree(folder)
    return mistakes


# What a team's or policy's name must not contain: terminal control in both forms, bidirectional
# controls, invisible characters, lines, spaces at its ends; nor may it be empty.
TRICKS = {"escape": "a\x1b[2J", "csi": "a\x9b2J", "title": "a\x1b]0;x\x07", "delete": "a\x7f",
          "turned": "a\u202etxt", "isolated": "a\u2066b", "unseen": "a\u200bb", "soft": "a\u00adb",
          "tagged": "a\U000e0041", "first": "\ufeffa", "lines": "a\nb", "paragraph": "a\u2029b",
          "return": "a\rb", "tab": "a\tb", "end": "a ", "begin": " a", "empty": "", "long": "a" * 65}
# Valid, if odd: they must arrive as text and nothing else.
ODD = ("=HYPERLINK(1)", "@SUM(1)", "'; DROP TABLE team; --", "../../etc", "%s%n", "null", "-1",
       "<b>a</b>", "Équipe \U0001f600", "${HOME}")


def _tricked(text):
    """The parts of `text` that could deceive a terminal or a reader."""
    return [c for c in text if c in "\x1b\x9b\x07\r\u202e\u2066\u200b\u00ad\ufeff\u2029"]


def run_names(suite):
    """Names that try to deceive a board's readers."""
    host = suite.host
    folder = host.root / "names"
    folder.mkdir(exist_ok=True)
    (folder / "run").write_text("#!/bin/sh\nprintf '\\342\\200\\256turned \\302\\2332J' >&2; exit 3\n")
    (folder / "run").chmod(0o755)
    mistakes = []

    def write(name):
        (folder / "policy.json").write_text(json.dumps({"name": name, "command": ["./run"]}))

    for kind, name in TRICKS.items():
        write(name)
        mistakes += _refused(f"a policy's name: {kind}",
                             host.verb("submit", folder, "--track", "rt", "--team", "Names"))
        write("fine")
        if kind not in ("empty",):
            mistakes += _refused(f"a team's name: {kind}",
                                 host.verb("submit", folder, "--track", "rt", f"--team={name}"))
        body = json.dumps({"artefact": "0" * 64, "team": name, "track": "rt"})
        mistakes += _api_refuses(f"a team by HTTP: {kind}", host, "/v1/submissions", body)
    for name in ODD:
        write(name)
        done = host.verb("submit", folder, "--track", "rt-start", f"--team={name}", "--episodes", 1,
                        "--json")
        if done.returncode != 0:
            mistakes.append(f"{name!r} was refused: {done.stderr.decode(errors='replace')[:200]}")
            continue
        submission = json.loads(done.stdout)["submission"]
        if host.wait(submission, 60) is None:
            mistakes.append(f"the submission of {name!r} did not end")
        if host.get(f"/v1/submissions/{submission}")["team"] != name:
            mistakes.append(f"{name!r} became another team")
        shown = host.verb("show", submission, "--episodes").stdout.decode(errors="replace")
        if _tricked(shown) or "turned" not in shown:
            mistakes.append(f"show plays the tricks of what a policy printed: {shown[-200:]!r}")
    shutil.rmtree(folder)
    return mistakes


# Look-alikes of "Team Blue": other spaces, invisible or blank characters, letters of other scripts,
# digits, other cases and widths.
LOOK_ALIKES = (
    "Team\u00a0Blue", "Team\u202fBlue", "Team\u3000Blue", "Team  Blue", "Team \ufe0fBlue",
    "Team Blue\U000e0100", "Team Blue\u3164", "Team\u3164Blue", "Team \u115fBlue", "Team Blue\uffa0",
    "Te\u034fam Blue", "Team\u2800Blue", "Team Blue\u2800", "Te\u0430m Blue", "\u0422eam Blue",
    "T\u0435am Blu\u0435", "Team \u0392lue", "TEAM BLUE", "team blue", "Team BIue", "Team B1ue",
    "Tearn Blue", "\uff34eam Blue", "Team \u212clue", "Team\u180e Blue", "Team\u1680Blue")


def _hand_in(host, artefact, team, start, teams, mistakes):
    """Adds the name of the team that this becomes, if any."""
    start.wait()
    body = json.dumps({"artefact": artefact, "team": team, "track": "rt-start", "episodes": 1})
    try:
        teams.append(host.post("/v1/submissions", body)["team"])
    except ApiError as error:
        if error.answer["error"]["code"] not in ("look_alike", "bad_request"):
            mistakes.append(f"{team!r}: {error}")


def run_look_alikes(suite):
    """Concurrent first submissions of many teams with look-alike names."""
    host = suite.host
    archive = archives.good()["plain.tar"]
    artefact = host.post("/v1/artefacts", archive, "application/x-tar")["artefact"]
    names = ("Team Blue", *LOOK_ALIKES)
    start, teams, mistakes = threading.Barrier(len(names)), [], []
    threads = [threading.Thread(target=_hand_in,
                                args=(host, artefact, name, start, teams, mistakes))
               for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if len(set(teams)) != 1:
        mistakes.append(f"these are teams beside one another: {sorted(set(teams))!r}")
    return mistakes


def _change(folder, stop):
    """Keeps changing a submission: its files' sizes, names and kinds."""
    while not stop.is_set():
        for i in range(20):
            file, link = folder / f"data{i}", folder / "link"
            with contextlib.suppress(OSError):
                file.write_bytes(b"x" * random.randrange(200000))
            with contextlib.suppress(OSError):
                os.replace(file, folder / f"data{(i + 1) % 20}")
            with contextlib.suppress(OSError):
                link.symlink_to("/etc/passwd")
                os.replace(link, file)
            with contextlib.suppress(OSError):
                os.replace(folder / "sub", folder / "other")
                (folder / "sub").mkdir(exist_ok=True)


def run_changing(suite):
    """A folder that changes while it is packed: accepted as it was at some moment, or rejected."""
    host = suite.host
    folder = host.root / "changing"
    (folder / "sub").mkdir(parents=True, exist_ok=True)
    for name, content, mode in archives.GOOD:
        (folder / name).write_bytes(content)
        (folder / name).chmod(mode)
    stop, mistakes = threading.Event(), []
    changer = threading.Thread(target=_change, args=(folder, stop))
    changer.start()
    try:
        for i in range(12):
            done = host.verb("submit", folder, "--track", "rt-start", "--team", "Changing",
                            "--episodes", 1, "--json")
            if done.returncode != 0:
                mistakes += _refused(f"submission {i}", done)
                continue
            submission = json.loads(done.stdout)["submission"]
            status = host.wait(submission, 60)
            rows = host.result(submission)["episode_rows"]
            if status is None or [row["outcome"] for row in rows] != ["crash"]:
                mistakes.append(f"submission {i} ended as {status and status['state']}")
    finally:
        stop.set()
        changer.join()
    shutil.rmtree(folder)
    return mistakes


CASES = (
    SubmissionCase(47, "archives that bomb, climb and lie", run_archives, quick=False),
    SubmissionCase(48, "manifests and limits that are none", run_manifests, quick=False),
    SubmissionCase(73, "a folder that changes while it is submitted", run_changing, quick=False),
    SubmissionCase(74, "names that trick those who read them", run_names, quick=False),
    SubmissionCase(85, "crowds of clients that are silent, slow or idle", crowds.run_crowds),
    SubmissionCase(86, "reruns without end", crowds.run_hoard, quick=False),
    SubmissionCase(105, "teams that look like others", run_look_alikes, quick=False),
    SubmissionCase(106, "a curious program in a phase with hidden seeds", hidden.run_curious,
                   quick=False),
)
