"""A receiver of webhooks that behaves as it is told."""

import http.server
import json
import socket
import struct
import threading

# What a receiver can do with a request.
ANSWERS = ("ok", "fail", "redirect", "hang", "reset", "endless", "endless_head", "dribble")


class Receiver:
    """Listens on 127.0.0.1 and keeps what came: `requests` has (path, headers, body) of each. `how`
    is one of ANSWERS, and may be changed at any time; `fail_first` requests are answered 500."""

    def __init__(self, how="ok", fail_first=0):
        self.how, self.fail_first = how, fail_first
        self.requests = []
        self.stopped = threading.Event()
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                receiver.handle(self)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True)
        self.thread.start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server.server_port}/hook"

    @property
    def events(self):
        return [json.loads(body) for _, _, body in self.requests]

    def handle(self, request):
        body = request.rfile.read(int(request.headers["Content-Length"]))
        self.requests.append((request.path, request.headers, body))
        how = self.how
        if self.fail_first > 0:
            self.fail_first -= 1
            how = "fail"
        try:
            getattr(self, "_" + how)(request)
        except OSError:
            pass  # the daemon hung up

    def _answer(self, request, status, **headers):
        request.send_response(status)
        for name, value in {"Content-Length": "0", **headers}.items():
            request.send_header(name, value)
        request.end_headers()

    def _ok(self, request):
        self._answer(request, 204)

    def _fail(self, request):
        self._answer(request, 500)

    def _redirect(self, request):
        self._answer(request, 302, Location=self.url + "/elsewhere")

    def _hang(self, _):
        self.stopped.wait(120)

    def _reset(self, request):
        request.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        request.connection.close()

    def _endless(self, request):
        request.wfile.write(b"HTTP/1.1 500 No\r\n\r\n")
        while not self.stopped.is_set():
            request.wfile.write(b"x" * 65536)

    def _endless_head(self, request):
        request.wfile.write(b"HTTP/1.1 200 OK\r\nX: ")
        while not self.stopped.is_set():
            request.wfile.write(b"x" * 65536)

    def _dribble(self, request):
        for byte in b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 1000:
            if self.stopped.wait(0.05):
                return
            request.wfile.write(bytes([byte]))

    def close(self):
        self.stopped.set()
        self.server.shutdown()
        self.server.server_close()
