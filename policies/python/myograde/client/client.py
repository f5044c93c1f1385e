"""The client: one method for each request of participants."""

from __future__ import annotations

import json
import os
import secrets
import tempfile
import time
import urllib.parse
from typing import Any, Callable, Iterator, Sequence

from ..errors import DeadlinePassed, ServerError, Unreachable, WrongUse
from .archive import pack, runtimes_of
from .ranking import packed_score
from .records import Record, board_record, episode_record, flat, marks_of
from .server import Server, choose_server
from .transport import ANSWER_S, UPLOAD_S, Lost, Transport, size_of

Json = dict[str, Any]
FINAL_STATES = frozenset(("done", "failed", "cancelled", "grader_error"))
# Events of the public record after which any board may be another.
CHANGES = ("banned", "unbanned", "published", "revealed", "applied", "dropped")
# Each poll takes processor time from the policies that are graded.
SHORTEST_POLL_S, LONGEST_POLL_S, POLLS_IN_A_WAIT = 0.25, 1.0, 20
PATIENCE_S = 30.0  # with a server that does not answer while a submission is followed
TRIES, BEFORE_RETRY_S = 3, 1.0  # a daemon that was restarted in between is there again
PAGE = 1000
MAX_PRINTED = 64 << 10


class Client:
    """Talks to one server: without arguments, the one that the program myograde would use:
    MYOGRADE_SERVER with MYOGRADE_TOKEN, else that of `myograde login`, else the daemon of this
    host.

    `server` is https://HOST:PORT; `socket` or `data` name a daemon of this host; `ca_file` has the
    authorities that may have signed the server's certificate. Every method raises ServerError if
    the server refuses, Unreachable if it does not answer, and WrongUse if an argument can't be
    used. Every request has a deadline of a minute, an upload one of 16. A client keeps no
    connection open, and may be used by several threads."""

    def __init__(self, server: str | None = None, *,
                 socket: str | os.PathLike[str] | None = None,
                 data: str | os.PathLike[str] | None = None, token: str | None = None,
                 ca_file: str | os.PathLike[str] | None = None) -> None:
        self.server: Server = choose_server(server, socket=socket, data=data, token=token,
                                            ca_file=ca_file)
        self._transport = Transport(self.server)

    # --- what there is ---

    def whoami(self) -> Json:
        """Who the caller is to the server: `role`, `teams`, `token`."""
        return self._get("/v1/whoami")

    def require_organiser(self) -> None:
        """WrongUse if the server takes the caller for less."""
        if (role := self.whoami().get("role")) not in ("organiser", "operator"):
            raise WrongUse(f"{self.server} takes this for a {role}, but it acts for every team: give it an organiser's "
                           "token (myograde token create)")

    def tracks(self) -> list[Record]:
        """One record for each profile of each track that can be submitted to."""
        tracks = self._get("/v1/tracks", tracks=list)["tracks"]
        return [flat({"track": track["track"], "kind": track["kind"],
                      "default": profile["profile"] == track["default_profile"], **profile})
                for track in tracks for profile in track["profiles"]]

    def phases(self) -> list[Record]:
        """One record for each phase of each challenge."""
        return [flat({"challenge": challenge["challenge"], **phase})
                for challenge in self._get("/v1/challenges", challenges=list)["challenges"]
                for phase in challenge["phases"]]

    def runtimes(self) -> list[Record]:
        """One record for each runtime that a policy.json may name: `runtime`, `digest`, `packages`."""
        return [flat(runtime) for runtime in self._get("/v1/runtimes", runtimes=list)["runtimes"]]

    # --- submitting ---

    def submit(self, path: str | os.PathLike[str], *, team: str, track: str | None = None,
               phase: str | None = None, profile: str | None = None, episodes: int | None = None,
               seeds: Sequence[int] | None = None, name: str | None = None) -> Json:
        """Uploads a submission (a folder with a policy.json, an executable file, an archive of such a
        folder, or a container image) and submits it for grading; returns its status, with its number under
        "submission". With `episodes` or `seeds` it is practice. `name` is shown on boards instead of the submission's
        own. If the answer is lost, the request is sent again and takes effect
        once."""
        track = self.track_of(track, phase)
        artefact = self.upload(path, team=team, track=track, name=name)["artefact"]
        return self.submit_artefact(artefact, team=team, track=track, phase=phase, profile=profile,
                                    episodes=episodes, seeds=seeds, key=secrets.token_hex(16))

    def upload(self, path: str | os.PathLike[str], *, team: str, track: str | None = None,
               phase: str | None = None, name: str | None = None, check_runtimes: bool = True,
               largest_bytes: int | None = None) -> Json:
        """Only uploads; the answer has the id of the content under "artefact". WrongUse, with nothing sent, if the
        server lacks a runtime, or if a zip archive unpacks to more than `largest_bytes`. Without `check_runtimes`, for
        a stranger's archive, only the server opens a tar. MyogradeError if there is no space to pack it."""
        track = self.track_of(track, phase)
        if check_runtimes:
            self._check_runtimes(runtimes_of(path))
        query = urllib.parse.urlencode({"team": team, "track": track})
        with tempfile.TemporaryFile() as archive:
            pack(path, archive, name, largest_bytes=largest_bytes)

            def send() -> Json:
                archive.seek(0)
                return self._transport.ask("POST", f"/v1/artefacts?{query}", archive,
                                           size=size_of(archive), timeout_s=UPLOAD_S,
                                           headers={"Content-Type": "application/x-tar"})

            # The same content has the same id.
            return self._with(_with_retries(send), artefact=str)

    def submit_artefact(self, artefact: str, *, team: str, key: str, track: str | None = None,
                        phase: str | None = None, profile: str | None = None,
                        episodes: int | None = None, seeds: Sequence[int] | None = None) -> Json:
        """Submits an upload for grading, as submit() does. With the same `key` it takes effect once, for a day,
        whichever process asks."""
        given = {"artefact": artefact, "team": team, "track": self.track_of(track, phase),
                 "phase": phase, "profile": profile, "episodes": episodes,
                 "seeds": None if seeds is None else [int(seed) for seed in seeds]}
        request = {name: value for name, value in given.items() if value is not None}
        return self._with(self.ask("/v1/submissions", request, key=key), submission=int)

    def cancel(self, submission: int, reason: str | None = None) -> Json:
        """Cancels a submission; its status then has "cancel". Recorded episodes are kept."""
        body = {} if reason is None else {"reason": reason}
        return self._post(f"{_address(submission)}/cancel", body, retry=False)

    # --- following ---

    def status(self, submission: int) -> Json:
        """A submission's status: `state`, `episodes`, `waiting`, `reason` and more."""
        return self._get(_address(submission), state=str, episodes=dict)

    def follow(self, submission: int, *, timeout_s: float) -> Iterator[Json]:
        """Yields the submission's status at once and at each change of its state or its number of
        episodes, up to its end. DeadlinePassed after `timeout_s`; grading continues. A server that does not answer is
        retried for half a minute."""
        begun = heard = time.monotonic()
        shown = None
        while True:
            left = begun + timeout_s - time.monotonic()
            try:
                status = self._with(
                    self._transport.ask("GET", _address(submission),
                                        timeout_s=max(1.0, min(left, ANSWER_S))),
                    state=str, episodes=dict)
            except (Unreachable, ServerError) as error:
                if not error.passes or time.monotonic() - heard > PATIENCE_S:
                    raise
            else:
                heard = time.monotonic()
                now = (status["state"], status["episodes"], status.get("waiting"))
                if now != shown:
                    yield status
                shown = now
                if status["state"] in FINAL_STATES:
                    return
            left = begun + timeout_s - time.monotonic()
            if left <= 0:
                state = "unknown" if shown is None else shown[0]
                raise DeadlinePassed(f"submission {submission} is still {state} after "
                                     f"{timeout_s:g} s; grading continues, and you can follow it again")
            pause = (time.monotonic() - begun) / POLLS_IN_A_WAIT
            time.sleep(min(max(pause, SHORTEST_POLL_S), LONGEST_POLL_S, left))

    def wait(self, submission: int, *, timeout_s: float,
             on_change: Callable[[Json], None] | None = None) -> Json:
        """The status at the end, as follow() has it; `on_change` is called with each one."""
        for status in self.follow(submission, timeout_s=timeout_s):
            if on_change is not None:
                on_change(status)
        return status

    # --- results ---

    def show(self, submission: int) -> Json:
        """The whole result of a submission: `aggregate`, `outcomes`, `hashes` and more."""
        return self._get(f"{_address(submission)}/result")

    def episodes(self, submission: int) -> list[Record]:
        """One record for each recorded episode: `index`, `outcome`, `reason`, the track's metrics
        under their names, `facts.…`, `details.…`, `fault.…`. What a phase withholds is None."""
        result = self._get(f"{_address(submission)}/result?episodes=1", episode_rows=list)
        return [episode_record(row) for row in result["episode_rows"]]

    def leaderboard(self, *, track: str | None = None, phase: str | None = None,
                    profile: str | None = None, board: str | None = None) -> list[Record]:
        """One record for each row of a board, best first: `rank` (None for baselines), `team`,
        `submission`, `name` and the metrics."""
        board_of_all = self.board(track=track, phase=phase, profile=profile, board=board)
        return [board_record(row) for row in board_of_all["rows"]]

    def board(self, *, track: str | None = None, phase: str | None = None,
              profile: str | None = None, board: str | None = None) -> Json:
        """A board as a whole: `rows` as they are answered, `rules`, `config`, `columns` and more. packed_score() makes
        of it, and of a result, one number that sorts as the board does."""
        if (track is None) == (phase is None):
            raise WrongUse("give the track or the phase of the leaderboard")
        query = _query(track=track, phase=phase, profile=profile, board=board)
        return self._get(f"/v1/leaderboard?{query}", rows=list)

    def submissions(self, *, team: str | None = None, track: str | None = None,
                    profile: str | None = None, phase: str | None = None,
                    state: str | None = None) -> Iterator[Record]:
        """One record for each submission that the caller may see, newest first; pages are fetched as needed."""
        before = None
        while True:
            query = _query(team=team, track=track, profile=profile, phase=phase, state=state,
                           limit=PAGE, before=before)
            page = self._get(f"/v1/submissions?{query}", submissions=list)
            yield from map(flat, page["submissions"])
            before = page.get("next_before")
            if before is None:
                return

    def page_of(self, submission: int, pages: str | None = None) -> str:
        """Where people see a submission: on this server, or where its `pages` are. "" if that is the socket of this
        host."""
        root = pages or ("" if self.server.socket else str(self.server))
        return f"{root.rstrip('/')}/submission?id={submission}" if root else ""

    def receipt(self, submission: int) -> Json:
        """The signed receipt, which `myograde verify` checks."""
        return self._get(f"{_address(submission)}/receipt")

    # --- for organisers, and for sites that show results elsewhere ---

    def counting_result(self, submission: int) -> Json:
        """The result that counts, as show() has it: that of the latest rejudge in force, else the original one."""
        return self._counting_result(self.status(submission))

    def _counting_result(self, status: Json) -> Json:
        counts = {None: status["evaluation"]}  # by rejudge, oldest first
        for evaluation in status["evaluations"]:
            number = evaluation["rejudge"]
            if number and number not in counts and evaluation["state"] in ("done", "failed"):
                rejudge = self._get(f"/v1/rejudges/{number}")
                if rejudge["state"] == "applied" and rejudge["purpose"] == "rules":
                    counts[number] = evaluation["evaluation"]  # the first of its repetitions
        return self._get(f"/v1/evaluations/{[*counts.values()][-1]}")

    def kept_off(self, submission: int) -> list[str]:
        """What keeps a submission off boards, each as words with the reason: marks, and its team's ban."""
        return self._kept_off(self.status(submission))

    def _kept_off(self, status: Json) -> list[str]:
        team, acts = self.team(status["team"]), {
            f"{mark} by the organisers": act for mark, act in marks_of(status).items() if mark != "baseline"}
        if team["banned"]:
            bans = [act for act in team["events"] if act["event"] == "banned"]
            acts["the organisers have banned the team"] = bans[-1]
        return [f"{what}: {act['reason'] or 'no reason given'}" for what, act in acts.items()]

    def ending(self, submission: int) -> Json | None:
        """How a submission ended, as its team may see it; None while it has not. `kind` is finished, failed, or
        cancelled, also by what keeps it off boards; `why` is the reason, or ""; `words` say the same in lines; `shown`
        says of aggregate, outcomes and output whether its phase shows them; `stdout` and `stderr` are what the policy
        printed last, if that is shown, in at most 64 KiB; `result` is the one that counts, whole."""
        status = self.status(submission)
        if status["state"] not in FINAL_STATES:
            return None
        result, kept_off = self._counting_result(status), self._kept_off(status)
        withheld = [phase for phase in self.phases()
                    if phase["phase"] == status["phase"] and not (phase["published"] or phase["revealed"])]
        shown = {part: not withheld or withheld[0][f"show.{part}"] for part in ("aggregate", "outcomes", "output")}
        kind = {"done": "finished", "cancelled": "cancelled"}.get(result["state"], "failed")
        printed = {of: "".join(f"\nepisodes {block['first']} to {block['last']}:\n{block[f'{of}_tail']}"
                               for block in result["output"] if shown["output"] and block[f"{of}_tail"])[:MAX_PRINTED]
                   for of in ("stdout", "stderr")}
        kind, why = ("cancelled", kept_off[-1]) if kept_off else (kind, result["reason"] or "")
        words = [f"MyoGrade's submission {submission} is {kind} ({result['state']}): {result['episodes']['done']} of "
                 f"{result['episodes']['total']} episodes were played.", why]
        if shown["outcomes"]:
            words.append(", ".join(f"{outcome}: {count}" for outcome, count in sorted(result["outcomes"].items())))
        return {"kind": kind, "why": why, "words": list(filter(None, words)), "shown": shown, "result": result,
                **printed}

    def out_of_order(self, board: Json) -> list[tuple[str, str, bool]]:
        """Teams that stand next to each other on a board (board()), the better first, but the other way round where one
        sorts by packed_score(), of equal scores the newest first, and shows of each team the first; and whether their
        scores are equal."""
        best: dict[str, tuple[float, int]] = {}
        where = {key: board[key] for key in ("phase", "track", "profile")}
        for known in self.submissions(**where, state="done"):
            number, team = known["submission"], known["team"]
            status = self.status(number)
            result = self._counting_result(status)
            if known["ranked"] and result["hashes"]["config"] == board["config"] and not self._kept_off(status):
                entry = packed_score(board, result["aggregate"]), number
                best[team] = max(entry, best.get(team, entry))
        here = [row["team"] for row in board["rows"] if row["team"] in best and not row["baseline"]]
        return [(above, below, best[above][0] == best[below][0])
                for above, below in zip(here, here[1:]) if best[above] < best[below]]

    def changed_since(self, size: int | None) -> tuple[int, set[int] | None]:
        """The size of the public record, and the submissions whose place on boards may have changed since it had `size`
        entries; None if that may be any, as after a ban, a rejudge, or with a `size` of None. Results that are new, and
        bands that they move (band_openers), are not told."""
        now = self._get("/v1/record/head", head=dict)["head"]["size"]
        acts = [entry["entry"] for entry in self.record(size)] if size not in (None, now) else []
        if size is None or any(act["kind"] == "config" or act.get("event") in CHANGES for act in acts):
            return now, None
        return now, {act["submission"] for act in acts if act["kind"] == "marked"}

    def record(self, first: int = 0) -> Iterator[Json]:
        """The entries of the public record from the one with the index `first` on; pages are fetched as needed."""
        while entries := self._get(f"/v1/record?from={first}&limit={PAGE}", entries=list)["entries"]:
            yield from entries
            first = entries[-1]["index"] + 1

    def withdraw(self, submission: int, reason: str) -> None:
        """Takes a submission off boards at its team's wish: cancels it if no episode has ended, else hides it, as a
        cancel would then keep its content from being graded again. Practice that has begun is left alone."""
        status = self.status(submission)
        if status["state"] not in FINAL_STATES and status["episodes"]["done"] == 0:
            self.cancel(submission, reason)
        elif status["ranked"]:
            self.mark(submission, "hidden", reason=reason)

    def readmit(self, submission: int, reason: str) -> None:
        """Shows again what withdraw() has hidden for a reason that begins with `reason`."""
        hidden = marks_of(self.status(submission)).get("hidden")
        if hidden and (hidden["reason"] or "").startswith(reason):
            self.mark(submission, "hidden", hold=False)

    def mark(self, submission: int, mark: str, *, hold: bool = True, reason: str | None = None) -> Json:
        """Marks a submission as `hidden`, `disqualified` or `baseline`, or with `hold=False` takes the mark away."""
        return self._post(f"{_address(submission)}/marks", {
            "mark": mark, "set": hold, **({} if reason is None else {"reason": reason})}, retry=False)

    def team(self, name: str) -> Json:
        """A team, by its present name or a former one: `banned`, `members`, `events` and more."""
        return self._get(f"/v1/teams/{urllib.parse.quote(name, safe='')}", events=list)

    def make_team(self, *names: str, reason: str) -> Json:
        """Makes a team under the first of `names` that is allowed and nobody else's, or returns the one that was made
        before for the same `reason`, so that a lost answer does no harm. ServerError if there is no such name."""
        for name in names:
            try:
                return self._post("/v1/teams", {"team": name, "reason": reason}, retry=False)
            except ServerError as error:
                known = self.team(name) if error.code == "conflict" else {"events": []}
                if any(act["event"] == "created" and act["reason"] == reason for act in known["events"]):
                    return known
                if error.code not in ("bad_request", "conflict", "look_alike") or name == names[-1]:
                    raise
        raise WrongUse("give at least one name for the team")

    # --- requests ---

    def ask(self, path: str, body: Json | None = None, *, key: str | None = None) -> Json:
        """The answer to any request of server/api/ADDRESSES.md: a GET, or with `body` a POST. With `key`,
        its Idempotency-Key, it is sent again if the answer is lost, and takes effect once."""
        if body is None:
            return self._get(path)
        return self._post(path, body, {"Idempotency-Key": key} if key else None, retry=bool(key))

    def track_of(self, track: str | None, phase: str | None) -> str:
        """The track, or that of the phase. WrongUse if there is neither."""
        if track is None and phase is None:
            raise WrongUse("give a track, or a phase of a challenge")
        for known in self.phases() if track is None else []:
            if known["phase"] == phase:
                return known["track"]
        if track is None:
            raise WrongUse(f'there is no phase "{phase}"; phases() lists the phases')
        return track

    def _check_runtimes(self, needed: list[str]) -> None:
        if not needed:
            return
        offered = [record["runtime"] for record in self.runtimes()]
        for name in needed:
            if name not in offered:
                raise WrongUse(f'policy.json asks for the runtime "{name}", which this server does not '
                               f"have; it has {', '.join(offered) or 'none'}; nothing was sent")

    def _get(self, path: str, **wanted: type) -> Json:
        return self._with(_with_retries(lambda: self._transport.ask("GET", path)), **wanted)

    def _with(self, answer: Json, **wanted: type) -> Json:
        """The answer, which must have these keys of these types."""
        for key, kind in wanted.items():
            if not isinstance(answer.get(key), kind):
                raise ServerError(200, "unreadable", f'the answer of {self.server} lacks "{key}"; '
                                  "check that it is a MyoGrade server")
        return answer

    def _post(self, path: str, body: Json, headers: dict[str, str] | None = None, *,
              retry: bool = True) -> Json:
        headers = {"Content-Type": "application/json", **(headers or {})}
        text = json.dumps(body).encode()

        def send() -> Json:
            return self._transport.ask("POST", path, text, headers=headers)

        return _with_retries(send) if retry else send()


def _with_retries(send: Callable[[], Json]) -> Json:
    """For requests that take effect only once, however often they arrive."""
    for tried in range(1, TRIES + 1):
        try:
            return send()
        except Lost:
            if tried == TRIES:
                raise
            time.sleep(BEFORE_RETRY_S)
    raise AssertionError("not reached")


def _address(submission: int) -> str:
    if isinstance(submission, bool) or not isinstance(submission, int) or submission < 1:
        raise WrongUse(f"{submission!r} is not a submission's number")
    return f"/v1/submissions/{submission}"


def _query(**values: Any) -> str:
    given = {key: value for key, value in values.items() if value is not None}
    return urllib.parse.urlencode(given)
