"""One HTTP request after another, each on its own connection and with one deadline, so that no server can stall a
caller by sending a byte now and then."""

from __future__ import annotations

import http.client
import json
import os
import socket
import ssl
import threading
from typing import Any, BinaryIO, Mapping

from ..errors import ServerError, Unreachable, WrongUse
from .server import Server

CONNECT_S = 10.0
# The server's own deadlines are 30 s, and 900 s for an upload; a little more here, so that its own
# sentence arrives.
ANSWER_S, UPLOAD_S = 60.0, 960.0
MAX_ANSWER_BYTES = 1 << 30
MAX_SENTENCE = 4000
PIECE = 256 << 10


class Lost(Unreachable):
    """The request may have arrived, but there is no answer."""


class Transport:
    def __init__(self, server: Server) -> None:
        self.server = server
        self._tls = _context(server) if server.scheme == "https" else None

    def ask(self, method: str, path: str, body: bytes | BinaryIO | None = None, *, size: int = 0,
            headers: Mapping[str, str] | None = None, timeout_s: float = ANSWER_S) -> Any:
        """The JSON of the answer. ServerError with its code and sentence if the server refuses,
        Unreachable if there is no answer in `timeout_s`; Lost if the request may have arrived."""
        status, _, text = self.send(method, path, body, size=size, headers=headers,
                                    timeout_s=timeout_s)
        return _answer(self.server, status, text)

    def send(self, method: str, path: str, body: bytes | BinaryIO | None = None, *, size: int = 0,
             headers: Mapping[str, str] | None = None, timeout_s: float = ANSWER_S
             ) -> tuple[int, Mapping[str, str], bytes]:
        """The same for a server of another kind: the answer's status, headers and content, whatever
        they say."""
        with _Exchange(self.server, self._tls, timeout_s) as exchange:
            return exchange.run(method, path, body, size, dict(headers or {}))


class _Exchange:
    """A connection, and a timer that ends it."""

    def __init__(self, server: Server, tls: ssl.SSLContext | None, timeout_s: float) -> None:
        self._server, self._timeout_s = server, timeout_s
        self._over = False
        self._wire = _connect(server, min(CONNECT_S, timeout_s))
        self._timer = threading.Timer(timeout_s, self._end)
        self._timer.daemon = True
        self._timer.start()
        try:
            if tls is not None:
                self._wire = tls.wrap_socket(self._wire, server_hostname=server.host,
                                             do_handshake_on_connect=False)
                _shake_hands(self._wire, server)
            self._wire.settimeout(timeout_s)
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> _Exchange:
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        self._wire.close()

    def run(self, method: str, path: str, body: bytes | BinaryIO | None, size: int,
            headers: dict[str, str]) -> tuple[int, Mapping[str, str], bytes]:
        made = http.client.HTTPConnection("myograde", timeout=self._timeout_s, blocksize=PIECE)
        made.sock = self._wire
        made.auto_open = 0  # it is never opened anew without the timer
        headers["Host"] = "myograde" if self._server.socket else self._server.authority
        headers["Connection"] = "close"
        if body is not None:
            headers["Content-Length"] = str(len(body) if isinstance(body, bytes) else size)
        if self._server.token:
            headers["Authorization"] = f"Bearer {self._server.token}"
        try:
            try:
                made.request(method, path, body, headers)
            except (BrokenPipeError, ConnectionResetError):
                pass  # a body that is refused by its header: the reason is there to be read
            answer = made.getresponse()
            return answer.status, answer.headers, _read(answer)
        except (OSError, http.client.HTTPException) as error:
            late = self._over or isinstance(error, (TimeoutError, socket.timeout))
            reason = str(error) or type(error).__name__
            why = f"within {self._timeout_s:.0f} s" if late else f"({reason})"
            raise Lost(f"the server at {self._server} did not answer {why}; try again, or ask its "
                       "organiser") from error

    def _end(self) -> None:
        self._over = True
        try:
            # Below TLS, whose state is in use by the thread that waits.
            socket.socket.shutdown(self._wire, socket.SHUT_RDWR)
        except OSError:
            pass  # it has ended by itself


def _context(server: Server) -> ssl.SSLContext:
    """The certificate is always checked, host name included."""
    try:
        context = ssl.create_default_context(cafile=server.ca_file or None)
    except (OSError, ssl.SSLError) as error:
        raise WrongUse(f"{server.ca_file}: can't be read as PEM certificates ({error}); correct "
                       "ca_file, MYOGRADE_CA_FILE, or the login") from error
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


def _connect(server: Server, timeout_s: float) -> socket.socket:
    if not server.socket:
        try:
            return socket.create_connection((server.host, server.port), timeout_s)
        except OSError as error:
            raise Unreachable(f"can't reach a server at {server} ({error}); check the address "
                              "and the network, or ask its organiser") from error
    made = socket.socket(socket.AF_UNIX)
    made.settimeout(timeout_s)
    try:
        made.connect(server.socket)
    except OSError as error:
        made.close()
        if isinstance(error, PermissionError):
            raise Unreachable(f"this user has no access to the daemon on {server}; run this as the "
                              "daemon's user, or ask the organiser for its address") from error
        why = error.strerror or str(error)
        raise Unreachable(f"can't reach a daemon at {server} ({why}); start one with 'myograde "
                          "serve', or give the address of a server") from error
    return made


def _shake_hands(wire: ssl.SSLSocket, server: Server) -> None:
    try:
        wire.do_handshake()
    except ssl.SSLCertVerificationError as error:
        raise Unreachable(f"the certificate of {server} can't be trusted ({error.verify_message}); "
                          "if your lab has its own authority, give its certificate as ca_file"
                          ) from error
    except OSError as error:
        raise Unreachable(f"can't make a TLS connection to {server} ({error}); check the address, or try again in a "
                          "minute") from error


def _read(answer: http.client.HTTPResponse) -> bytes:
    pieces, size = [], 0
    while piece := answer.read(PIECE):
        pieces.append(piece)
        size += len(piece)
        if size > MAX_ANSWER_BYTES:
            raise http.client.HTTPException(f"the answer is larger than {MAX_ANSWER_BYTES} bytes")
    if answer.length:  # of a body with a known length
        raise http.client.IncompleteRead(b"", answer.length)
    return b"".join(pieces)


def _answer(server: Server, status: int, text: bytes) -> Any:
    if 300 <= status < 400:
        raise ServerError(status, "redirect", f"{server} redirects requests, and redirects are not followed, because "
                          "a token is for one server; give the server's own "
                          "address")
    try:
        answer = json.loads(text)
    except (ValueError, RecursionError):
        answer = None
    if 200 <= status < 300 and isinstance(answer, dict):
        return answer
    error = answer.get("error") if isinstance(answer, dict) else None
    if not isinstance(error, dict) or not isinstance(error.get("message"), str):
        raise ServerError(status, "unreadable", f"{server} answered with HTTP status {status} and no readable body")
    raise ServerError(status, _sanitized(str(error.get("code", ""))), _sanitized(error["message"]))


def _sanitized(text: str) -> str:
    """Without control characters that a terminal would obey."""
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in text[:MAX_SENTENCE])


def size_of(stream: BinaryIO) -> int:
    """The bytes of an open file."""
    return os.fstat(stream.fileno()).st_size
