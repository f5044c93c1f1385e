"""Case 106: a curious program in a phase with hidden seeds. It must see no seed and no secret, and its
team must find none in any answer of the daemon."""

import hashlib
import hmac
import json
import pathlib
import sqlite3

from host import Host
from support import client

PROGRAM = "c106_prints_all_it_sees.py"
PHASE, COUNT, TEAM = "final", 2, "Curious"
END_S = 150
LEAST_FILES = 30  # that the program read; fewer would show nothing


def _digest(key, message):
    return hmac.new(key, message.encode(), hashlib.sha256).digest()


def _number(digest):
    return int.from_bytes(digest[-8:], "big") & (2**63 - 1)


class Challenge(Host):
    """A daemon that holds a challenge of one phase with hidden seeds, which shows what it may."""

    def __init__(self, programs, source, user=None):
        super().__init__(programs, source, user)
        folder = self.configs / "challenges"
        folder.mkdir(exist_ok=True)
        (folder / "redteam.json").write_text(json.dumps({
            "form": 1, "title": "Red team", "phases": [
                {"name": PHASE, "title": "Final", "track": "rt-patient", "profile": "paper",
                 "seeds": {"committed": COUNT}, "opens_at": "2020-01-01T00:00:00Z",
                 "closes_at": "2200-01-01T00:00:00Z", "show": {"logs": False}}]}))

    def hidden(self):
        """What nobody may know, by name."""
        with sqlite3.connect(f"file:{self.data}/store.db?mode=ro", uri=True) as store:
            secret = store.execute("SELECT secret FROM phase_secret").fetchone()[0]
        store.close()
        words = {"secret": secret.hex(),
                 "policy_seed_secret": _digest(secret, f"myograde policy seeds/{PHASE}").hex(),
                 "seed_salt": _digest(secret, f"myograde seed salt/{PHASE}").hex()}
        for index in range(COUNT):
            words[f"seed{index}"] = str(_number(_digest(secret, f"myograde seeds/{PHASE}/{index}")))
        return words

    def token(self):
        self.post("/v1/teams", json.dumps({"team": TEAM, "reason": "red team"}))
        return self.post("/v1/tokens", json.dumps(
            {"role": "participant", "team": TEAM, "label": "red team"}))["token"]

    def read_as(self, token, path):
        """The bytes of an answer to the holder of a token."""
        connection = client.Connection(self.socket_path)
        try:
            connection.request("GET", path, headers={"Authorization": f"Bearer {token}"})
            return connection.getresponse().read()
        finally:
            connection.close()


def _paths(host, submission):
    rows = host.result(submission)["episode_rows"]
    yield from ("/v1/submissions", "/v1/challenges", "/v1/tracks", "/v1/health", "/v1/key",
                "/v1/export", "/v1/backup", f"/v1/quota?team={TEAM}",
                f"/v1/leaderboard?phase={PHASE}", f"/v1/submissions/{submission}",
                f"/v1/submissions/{submission}/result?episodes=1",
                f"/v1/submissions/{submission}/receipt")
    for row in rows:
        yield f"/v1/logs/{row['log']['sha256']}"


def _findings(result):
    lines = [line.split(" ", 2) for output in result["output"]
             for line in output["stderr_tail"].split("\n") if line.startswith("RT ")]
    return {words[1]: words[2] for words in lines if len(words) == 3}


def _judge(host, token, submission, words):
    result = host.result(submission)
    if [row["seed"] for row in result["episode_rows"]] != [
            int(words[f"seed{index}"]) for index in range(COUNT)]:
        yield "the phase was not played on the seeds that its secret gives"
    found = _findings(result)
    if int(found.get("files", 0)) < LEAST_FILES:
        yield f"the program read {found.get('files', 0)} files"
    if found.get("seen") != "nothing":
        yield f"the program saw {found.get('seen', 'not even its own report')}"
    for path in _paths(host, submission):
        answer = host.read_as(token, path)
        for name, word in words.items():
            forms = [word, f"{int(word):x}"] if word.isdigit() else [word]
            if any(form.encode() in answer for form in forms):
                yield f"{path} tells its team the {name}"


def run_curious(suite):
    source = pathlib.Path(suite.places["{source}"]).parents[1]
    with Challenge(suite.host.programs, source, suite.host.user) as host:
        host.start()
        words = host.hidden()
        folder = suite.folder(PROGRAM, ())
        (folder / "needles.bin").write_bytes(
            bytes(byte ^ 0xff for byte in json.dumps(words).encode()))
        token = host.token()
        done = host.verb("submit", folder, "--track", "rt-patient", "--phase", PHASE, "--team", TEAM,
                         "--json")
        if done.returncode != 0:
            return [f"submit: {done.stderr.decode(errors='replace').strip()}"]
        submission = json.loads(done.stdout)["submission"]
        status = host.wait(submission, END_S)
        if status is None or status["state"] != "done":
            faults = {row["fault"]["detail"] for row in host.result(submission)["episode_rows"]
                      if row["fault"]}
            return [f"the curious submission is {status and status['state']}: {faults}"]
        return list(_judge(host, token, submission, words))
