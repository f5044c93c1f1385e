"""Which server is asked, and as whom: the same choice as the program myograde makes."""

from __future__ import annotations

import dataclasses
import ipaddress
import json
import os
import pathlib
import re
import stat
import urllib.parse
from typing import Any

from ..errors import WrongUse

HOST_NAME = re.compile(r"[a-z0-9][a-z0-9.-]{0,252}$")
USUAL_PORTS = {"https": 443, "http": 80}
MAX_TOKEN, MAX_LOGIN_BYTES = 512, 64 << 10


@dataclasses.dataclass(frozen=True)
class Server:
    """An address, and what is shown there. Either `socket` is a path, or scheme, host and port are
    there."""

    socket: str = ""
    scheme: str = ""
    host: str = ""
    port: int = 0
    token: str = dataclasses.field(default="", repr=False)
    ca_file: str = ""  # authorities in PEM; "": those that this host trusts

    def __str__(self) -> str:
        if self.socket:
            return self.socket
        return f"{self.scheme}://{self.authority}"

    @property
    def authority(self) -> str:
        """Host and port, as a URL has them; the scheme's usual port is left out."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == USUAL_PORTS[self.scheme] else f"{host}:{self.port}"


def parse_server(text: str, what: str) -> Server:
    """An address as people write it: https://HOST:PORT, unix:PATH, or a path with a slash. WrongUse with `what` for
    anything else, and for http:// to another host."""
    if text.startswith("unix:") and len(text) > 5:
        return Server(socket=text[5:])
    if "://" not in text and "/" in text:
        return Server(socket=text)
    if "@" in text:
        raise WrongUse(f"{what}: leave user and password out of the address; "
                       '"myograde login" takes a token')
    try:
        parts = urllib.parse.urlsplit(text)
        scheme, host = parts.scheme.lower(), parts.hostname or ""
        port = parts.port if parts.port is not None else USUAL_PORTS.get(scheme, 0)
        numeric = _numeric(host)
        good = (scheme in USUAL_PORTS and port > 0 and parts.path in ("", "/")
                and not parts.query and not parts.fragment
                and (numeric is not None or HOST_NAME.match(host) is not None))
    except ValueError:
        good = False
    if not good:
        raise WrongUse(f'{what}: "{text[:80]}" is not a server\'s address: write https://HOST:PORT, '
                       "or the path of a daemon's socket")
    here = host == "localhost" or (numeric is not None and numeric.is_loopback)
    if scheme == "http" and not here:
        raise WrongUse(f"{what}: {text[:80]} is without TLS, so anybody on the network could read and change "
                       "everything; write https://, or for this host http://127.0.0.1")
    return Server(scheme=scheme, host=host if numeric is None else str(numeric), port=port)


def choose_server(server: str | None = None, *, socket: str | os.PathLike[str] | None = None,
                  data: str | os.PathLike[str] | None = None, token: str | None = None,
                  ca_file: str | os.PathLike[str] | None = None) -> Server:
    """The server of the arguments; else of MYOGRADE_SERVER, of MYOGRADE_DATA, of `myograde login`,
    or the daemon of this host. A token is sent only to its own server: MYOGRADE_TOKEN to that of MYOGRADE_SERVER, the
    login's to the login's. WrongUse if an address, a token or the login is not valid."""
    if server is not None and (socket is not None or data is not None):
        raise WrongUse("give the server's address, or the socket or data folder of a daemon of "
                       "this host, not both")
    login = None
    address = _address(server, socket, data)
    if address is None:
        login = read_login()
        address = (parse_server(login["server"], str(login_file())) if login is not None
                   else Server(socket=_socket(None)))
    given_file = os.fspath(ca_file) if ca_file is not None else _variable("MYOGRADE_CA_FILE")
    shown = token if token is not None else _own_token(address)
    if shown:
        check_token(shown, "token" if token is not None else "MYOGRADE_TOKEN")
    if not address.socket and not (shown and given_file):
        login = login or read_login()
        if login is not None and login["server"] == str(address):
            shown = shown or login["token"]
            given_file = given_file or login["ca_file"]
    return dataclasses.replace(address, token=shown or "", ca_file=given_file or "")


def check_token(token: str, what: str) -> str:
    """The token; WrongUse with `what` if this can't be one."""
    if not 0 < len(token) <= MAX_TOKEN or not all("!" <= sign <= "~" for sign in token):
        raise WrongUse(f"{what}: not a token, which is one word of at most {MAX_TOKEN} letters, digits and "
                       "punctuation marks, as the organiser gave it to you")
    return token


def login_file() -> pathlib.Path:
    """Where `myograde login` keeps the login."""
    configs = os.environ.get("XDG_CONFIG_HOME", "")
    # The XDG specification has relative paths ignored.
    folder = pathlib.Path(configs) if configs.startswith("/") else pathlib.Path.home() / ".config"
    return folder / "myograde/login.json"


def read_login() -> dict[str, str] | None:
    """`server`, `token` and `ca_file` ("" for none) of the login; None if there is none. WrongUse
    if it can't be used, or others may read the token in it."""
    path = login_file()
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _not_usable(path, f"can't be read ({error.strerror})") from error
    with open(descriptor, "rb") as stream:
        _check_rights(path, os.fstat(stream.fileno()))
        text = stream.read(MAX_LOGIN_BYTES + 1)
    try:
        login: Any = json.loads(text)
    except ValueError:  # not chained: the text could be quoted, with the token
        login = None
    known = {"server", "token", "ca_file"}
    if not isinstance(login, dict) or not {"server", "token"} <= set(login) <= known:
        raise _not_usable(path, "is not a login")
    login = {key: login.get(key) or "" for key in known}
    if not all(isinstance(value, str) for value in login.values()):
        raise _not_usable(path, "is not a login")
    check_token(login["token"], str(path))
    return login


def _address(server: str | None, socket: Any, data: Any) -> Server | None:
    if server is not None:
        return parse_server(server, "server")
    if socket is not None or data is not None:
        return Server(socket=os.fspath(socket) if socket is not None else _socket(data))
    if _variable("MYOGRADE_SERVER"):
        return parse_server(_variable("MYOGRADE_SERVER"), "MYOGRADE_SERVER")
    return Server(socket=_socket(None)) if _variable("MYOGRADE_DATA") else None


def _own_token(address: Server) -> str:
    """MYOGRADE_TOKEN, if it is for this server."""
    named = _variable("MYOGRADE_SERVER")
    own = not named or str(parse_server(named, "MYOGRADE_SERVER")) == str(address)
    return _variable("MYOGRADE_TOKEN") if own else ""


def _socket(data: str | os.PathLike[str] | None) -> str:
    folder = os.fspath(data) if data is not None else _variable("MYOGRADE_DATA")
    if not folder and hasattr(os, "geteuid") and os.geteuid() == 0:
        folder = "/var/lib/myograde"
    if not folder:
        given = os.environ.get("XDG_DATA_HOME", "")
        home = given if given.startswith("/") else os.path.expanduser("~/.local/share")
        folder = f"{home}/myograde"
    return f"{folder}/myograde.sock"


def _check_rights(path: pathlib.Path, info: os.stat_result) -> None:
    if not stat.S_ISREG(info.st_mode):
        raise _not_usable(path, "is not a file")
    if hasattr(os, "geteuid") and info.st_uid != os.geteuid():
        raise _not_usable(path, "belongs to another user")
    if os.name == "posix" and info.st_mode & 0o077:
        raise WrongUse(f"{path}: other users may read the token in it; withdraw that right (chmod 600), and have the "
                       "token replaced if somebody may have read it")


def _not_usable(path: pathlib.Path, why: str) -> WrongUse:
    return WrongUse(f'{path}: {why}; replace it with "myograde login", or remove it with "myograde logout"')


def _numeric(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _variable(name: str) -> str:
    return os.environ.get(name, "")
