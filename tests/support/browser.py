"""A headless Chromium, driven over its debugging pipe (the Chrome DevTools Protocol)."""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
import urllib.parse

ANSWER_S = 30
PROGRAM = shutil.which("chromium")


class BrowserError(RuntimeError):
    """The browser reported an error, or did not answer in time."""


class PageLeft(BrowserError):
    """The page that was asked is being left for another one."""


class Browser:
    """A browser with an empty profile. close() ends it, as does the end of a `with`."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="myograde-browser-")
        to_child, self.to_browser = os.pipe()
        self.from_browser, from_child = os.pipe()
        words = [PROGRAM, "--headless=new", "--remote-debugging-pipe", "--no-first-run",
                 "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking",
                 "--hide-scrollbars", f"--user-data-dir={self.folder}",
                 *(["--no-sandbox"] if os.geteuid() == 0 else []), "about:blank"]
        # The browser's ends of the pipe are the descriptors 3 and 4.
        self.process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{to_child} 4>&{from_child}', "bash", *words],
            pass_fds=(to_child, from_child), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=dict(os.environ, HOME=self.folder))
        os.close(to_child)
        os.close(from_child)
        self._rest = b""
        self._number = 0
        self._listeners = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.to_browser)
        os.close(self.from_browser)
        shutil.rmtree(self.folder, ignore_errors=True)

    def listen(self, session, listener):
        """Has `listener` called with the name and parameters of each event of a session."""
        self._listeners[session] = listener

    def pump(self, deadline):
        """Reads one message and returns it, after telling it to its listener if it is an event."""
        while b"\0" not in self._rest:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self.from_browser], [], [], left)[0]:
                raise BrowserError("the browser does not answer")
            piece = os.read(self.from_browser, 1 << 20)
            if not piece:
                raise BrowserError("the browser has ended")
            self._rest += piece
        text, _, self._rest = self._rest.partition(b"\0")
        message = json.loads(text)
        if "method" in message and message.get("sessionId") in self._listeners:
            self._listeners[message["sessionId"]](message["method"], message["params"])
        return message

    def send(self, method, session=None, **params):
        """Sends a command whose answer nobody waits for, and returns its number."""
        self._number += 1
        request = {"id": self._number, "method": method, "params": params,
                   **({"sessionId": session} if session else {})}
        data = memoryview(json.dumps(request).encode() + b"\0")
        while data:
            data = data[os.write(self.to_browser, data):]
        return self._number

    def call(self, method, session=None, timeout_s=ANSWER_S, **params):
        """The result of a command."""
        number = self.send(method, session, **params)
        deadline = time.monotonic() + timeout_s
        while True:
            answer = self.pump(deadline)
            if answer.get("id") == number:
                break
        if "error" in answer:
            kind = PageLeft if "navigated" in answer["error"]["message"] else BrowserError
            raise kind(f"{method}: {answer['error']}")
        return answer["result"]


class Page:
    """A tab. `requests` has the addresses that it asked for, `problems` what went wrong in it."""

    def __init__(self, browser, width=1280, height=900, dark=False):
        self.browser = browser
        self.requests, self.problems = [], []
        # Each has a profile of its own, so that nobody's login is another's.
        context = browser.call("Target.createBrowserContext")["browserContextId"]
        target = browser.call("Target.createTarget", url="about:blank", browserContextId=context)
        self.target = target["targetId"]
        self.session = browser.call("Target.attachToTarget", targetId=self.target,
                                    flatten=True)["sessionId"]
        browser.listen(self.session, self._note)
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=width < 600)
        self.call("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def _note(self, method, params):
        if method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.problems.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        elif method == "Page.javascriptDialogOpening":
            self.problems.append(f"a dialog: {params['message']}")

    def call(self, method, **params):
        return self.browser.call(method, session=self.session, **params)

    def evaluate(self, script):
        """The value of an expression, which may be a promise."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True,
                           returnByValue=True)
        if "exceptionDetails" in result:
            raise BrowserError(f"{script[:200]}: {result['exceptionDetails']}")
        return result["result"].get("value")

    def wait(self, script, timeout_s=ANSWER_S):
        """Waits until an expression is true, and returns its value."""
        deadline = time.monotonic() + timeout_s
        while True:
            with contextlib.suppress(PageLeft):
                if value := self.evaluate(script):
                    return value
            if time.monotonic() > deadline:
                raise BrowserError(f"{script} does not become true; the page: "
                                   + str(self.evaluate("document.body.innerText"))[:1500])
            time.sleep(0.05)

    def open(self, url, ready="document.getElementById('main')?.dataset.ready === 'yes'"):
        """Loads a page and waits until it is shown."""
        self.call("Page.navigate", url=url)
        self.wait(f"location.href === {json.dumps(url)} && ({ready})")

    def text(self):
        return self.evaluate("document.body.innerText")

    def screenshot(self, path):
        """Writes all of the page as a PNG."""
        image = self.call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(image))

    def close(self):
        self.browser.call("Target.closeTarget", targetId=self.target)


class AnsweredPage(Page):
    """A tab some of whose requests are answered by `answers` in the place of the server: by path, lists of
    (status, headers, body), of which the last one stays. `patterns` says which."""

    def __init__(self, browser, patterns, answers, **more):
        self.answers = answers
        super().__init__(browser, **more)
        self.take(*patterns)

    def take(self, *patterns):
        """Answers requests for such addresses from now on, and no others."""
        self.call("Fetch.enable", patterns=[{"urlPattern": one} for one in patterns])

    def _note(self, method, params):
        super()._note(method, params)
        if method != "Fetch.requestPaused":
            return
        path = urllib.parse.unquote(urllib.parse.urlsplit(params["request"]["url"]).path)
        known = self.answers.get(path, [(404, {}, {"error": {"code": "not_found",
                                                             "message": "There is no such log."}})])
        status, headers, body = known.pop(0) if len(known) > 1 else known[0]
        if not isinstance(body, bytes):
            body = json.dumps(body).encode()
        # Its answer is of no interest, and waiting for it here would take that of another command.
        self.browser.send("Fetch.fulfillRequest", self.session, requestId=params["requestId"],
                          responseCode=status,
                          responseHeaders=[{"name": name, "value": value}
                                           for name, value in headers.items()],
                          body=base64.b64encode(body).decode())
