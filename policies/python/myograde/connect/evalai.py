"""EvalAI's HTTP API, as a remote worker uses it."""

from __future__ import annotations

import http.client
import json
import pathlib
import time
import urllib.parse
import urllib.request
from typing import Any, Optional

from ..client.server import parse_server
from ..client.transport import PIECE, Transport
from ..errors import MyogradeError, Unreachable, WrongUse
from .settings import Settings

PAUSE_S, LONGEST_PAUSE_S, SILENT_S, DOWNLOAD_S = 60.0, 3600.0, 60.0, 3600.0


class EvalaiError(MyogradeError):
    """EvalAI refuses a request."""


class NotNow(Unreachable):
    """EvalAI answers nobody, or not us: nothing can be done with it for `pause_s` seconds."""

    def __init__(self, message: str, pause_s: float = PAUSE_S) -> None:
        super().__init__(message)
        self.pause_s = pause_s


class Evalai:
    def __init__(self, settings: Settings) -> None:
        self.settings, self.server = settings, settings.evalai.server.rstrip("/")
        self._transport = Transport(parse_server(self.server, "evalai.server"))

    def ask(self, method: str, path: str, body: Optional[dict[str, Any]] = None) -> Any:
        """The answer's JSON; None if what the path names is not there. EvalaiError, NotNow."""
        headers = {"Content-Type": "application/json", "Accept": "application/json"}
        content = None if body is None else json.dumps(body).encode()
        try:
            token = self.settings.secret(self.settings.evalai.token_file)  # with each request, so it can be replaced
            # A JSON Web Token has three parts; the other tokens are those of Django REST framework.
            headers["Authorization"] = f"{'Bearer' if token.count('.') == 2 else 'Token'} {token}"
            status, heads, text = self._transport.send(method, f"/api/{path}", content, headers=headers)
        except (Unreachable, WrongUse) as error:
            raise NotNow(f"EvalAI: {error}") from error
        try:
            answer = json.loads(text)
        except (ValueError, RecursionError):
            answer, status = text[:200].decode(errors="replace"), max(status, 500)  # not EvalAI, but what is before it
        if status < 300 or status == 404:
            return answer if status < 300 else None
        said = answer.get("error") or answer.get("detail") or answer if isinstance(answer, dict) else answer
        sentence = f"EvalAI answers {str(said)[:1000]!r} (HTTP status {status})"
        if status == 429:
            after = heads.get("Retry-After") or ""
            raise NotNow(sentence, min(max(float(after), 1), LONGEST_PAUSE_S) if after.isdecimal() else PAUSE_S)
        if status in (401, 403):
            raise NotNow(f"{sentence}: the token has expired, or is not that of a host of this challenge; put another "
                         "one into evalai.token_file, which is read each time")
        raise NotNow(sentence) if status >= 500 and method != "POST" else EvalaiError(sentence)

    def download(self, url: str, folder: pathlib.Path, largest_bytes: int) -> pathlib.Path:
        """A submission's file, under its own name, as a file that can be executed. WrongUse if it is gone or
        too large, EvalaiError if it can't be had now."""
        parts = urllib.parse.urlsplit(urllib.parse.urljoin(self.server, url))
        name = pathlib.PurePosixPath(urllib.parse.unquote(parts.path)).name.replace("\0", "")[-100:]
        path = folder / (name if name not in ("", "..") else "submission")
        deadline, size = time.monotonic() + DOWNLOAD_S, 0
        if not url or parts.scheme not in ("http", "https"):
            raise WrongUse("the submission has no file on EvalAI")
        try:
            # Without the token, which is not for where the files are.
            with urllib.request.urlopen(parts.geturl(), timeout=SILENT_S) as answer, open(path, "wb") as file:
                length = answer.length or 0  # 0: unknown
                while max(size, length) <= largest_bytes and (piece := answer.read(PIECE)):
                    size += file.write(piece)
                    if time.monotonic() > deadline:
                        raise TimeoutError(f"it took more than {DOWNLOAD_S:.0f} s")
                if size < length <= largest_bytes:
                    raise http.client.IncompleteRead(b"", length - size)
        except (OSError, ValueError, http.client.HTTPException) as error:
            status = getattr(error, "code", 0)  # of HTTP
            if 400 <= status < 500 and status != 429:
                raise WrongUse(f"the submission's file is gone from EvalAI (HTTP status {status})") from None
            raise EvalaiError(f"{parts.netloc}: a submission's file can't be had ({error})") from None
        if max(size, length) > largest_bytes:
            raise WrongUse(f"the submission's file has more than {largest_bytes} bytes; make it smaller")
        path.chmod(0o755)
        return path
