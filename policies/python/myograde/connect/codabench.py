"""The scoring program of a Codabench bundle, such as the one in bundle/."""

from __future__ import annotations

import contextlib
import html
import json
import pathlib
import re
import sys
import time

from ..client import Unreachable, WrongUse
from . import verdict
from .settings import Settings

# A compute worker's folders are named so, and a container sees where its own are mounted from.
WORKER = re.compile(r"/uPK-(\d+)_sID-(\d+)__")
MOUNTS = pathlib.Path("/proc/self/mountinfo")
PAGE = """<!doctype html><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'">
<title>{title}</title><h1>{title}</h1><p><a href="{page}">{page}</a><table>{rows}</table>
<pre>{stdout}</pre><pre>{stderr}</pre>
"""


def score(settings: Settings, given: pathlib.Path, output: pathlib.Path) -> int:
    """Has the submission in the folder `given` graded, and writes scores.json and detailed_results.html. 1 if it has
    no result."""
    submission, key = given / "res", (given / "ref/phase").read_text(encoding="utf-8").strip()
    worker = WORKER.search(MOUNTS.read_text(encoding="utf-8"))
    if worker is None:
        raise WrongUse("this host does not tell whose submission it is, as a compute worker of Codabench does")
    client, target, (user, number) = settings.client(), settings.target(key), worker.groups()
    where = {"team": settings.teams.get(user, f"Codabench user {user}"), "track": target.track, "phase": target.phase}
    (submission / "metadata").unlink(missing_ok=True)  # the compute worker's own
    for path in filter(pathlib.Path.is_file, submission.rglob("*")):  # zip archives lost what makes a file a program
        with open(path, "rb") as file:
            path.chmod(0o755 if file.read(4).startswith((b"\x7fELF", b"#!")) else 0o644)
    files = list(submission.iterdir())
    artefact = client.upload(files[0] if len(files) == 1 else submission, check_runtimes=False, **where)["artefact"]
    made = client.submit_artefact(artefact, profile=target.profile, episodes=target.episodes, **where,
                                  key=f"Codabench/{number}/{artefact}")["submission"]
    page, ended = client.page_of(made, settings.myograde.pages), None
    print(f"MyoGrade's submission {made}", page, flush=True)
    while ended is None:
        time.sleep(1)
        with contextlib.suppress(Unreachable):  # the compute worker ends this at the phase's execution_time_limit
            ended = verdict.judge(client, target, made, page)
    scores = {re.sub(r"\W+", "_", label).strip("_").lower(): number
              for columns in ended["columns"].values() for label, number in columns.items()}
    rows = list(scores.items()) if ended["shown"]["aggregate"] else []
    if ended["shown"]["outcomes"]:
        result = client.ask(f"/v1/evaluations/{ended['result']['evaluation']}?episodes=1&details=0")
        rows += [(f"episode {row['index']}", f"{row['outcome']} {row['reason']}") for row in result["episode_rows"]]
    texts = {"title": f"Submission {made} is {ended['kind']}", "page": page,
             "stdout": ended["stdout"], "stderr": ended["stderr"]}
    (output / "detailed_results.html").write_text(PAGE.format(
        rows="".join(f"<tr><td>{html.escape(name)}<td>{html.escape(str(value))}" for name, value in rows),
        **{name: html.escape(text) for name, text in texts.items()}), encoding="utf-8")
    print(ended["stdout"])
    print(ended["stderr"], file=sys.stderr)
    if ended["kind"] == "finished":
        (output / "scores.json").write_text(json.dumps(scores))
    return 0 if ended["kind"] == "finished" else 1
