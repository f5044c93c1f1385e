"""Runs the cases one after the other, each beside an honest submission, and inspects the host
after each."""

import json
import pathlib
import shutil
import socket
import threading
import time

import judge
import submissions
from host import Host
from more import MORE
from cases import CASES

HERE = pathlib.Path(__file__).resolve().parent
END_S = 150            # for a run to end, far above all of its budgets
CLEAN_S = 20           # how long leftovers are waited for before they are reported
MEMORY_SLACK_MIB = 24  # of the daemon, above what it used after its first submissions
TRIMMED_S = 25         # until it has given back what it does not use
SANITIZED_SLACK_MIB = 400  # AddressSanitizer quarantines freed memory
DESCRIPTOR_SLACK = 8   # the suite's own connections that are being closed
WARM_UP_RUNS = 3


def all_cases():
    return sorted((*CASES, *MORE, *submissions.CASES), key=lambda case: case.number)


class HostSockets:
    """What case 22 looks for: host sockets that a sandbox must not reach."""

    def __init__(self, root):
        self.tcp = socket.create_server(("127.0.0.1", 0))
        self.unix = socket.socket(socket.AF_UNIX)
        self.unix_path = str(root / "open.sock")
        self.unix.bind(self.unix_path)
        self.unix.listen()
        (root / "open.sock").chmod(0o777)
        self.name = f"redteam-{root.name}"
        self.abstract = socket.socket(socket.AF_UNIX)
        self.abstract.bind("\0" + self.name)
        self.abstract.listen()

    def close(self):
        for opened in (self.tcp, self.unix, self.abstract):
            opened.close()


class Honest:
    """An honest submission that is played repeatedly while something hostile runs."""

    def __init__(self, host, policy):
        self.host = host
        self.policy = policy
        self.alone = None
        self.runs = 0

    def play(self):
        submission = self.host.submit(self.policy, "rt-honest", "Honest")
        status = self.host.wait(submission, END_S)
        if status is None or status["state"] != "done":
            raise RuntimeError(f"the honest submission is {status and status['state']}: "
                               f"{status and status['reason']}")
        return judge.identity(self.host.result(submission))

    def warm_up(self):
        """Its results when run alone."""
        identities = {self.play() for _ in range(WARM_UP_RUNS)}
        if len(identities) != 1:
            raise RuntimeError("the honest submission alone gives different results each time")
        self.alone = identities.pop()

    def beside(self, stop, problems):
        """Plays at least once and until `stop`."""
        while True:
            try:
                if self.play() != self.alone:
                    problems.append("an honest submission beside it got another result")
            except (RuntimeError, OSError) as trouble:
                problems.append(f"an honest submission beside it failed: {trouble}")
            self.runs += 1
            if stop.is_set() or problems:
                return


class Suite:
    def __init__(self, build, source, user=None):
        self.build = pathlib.Path(build)
        self.host = Host(self.build / "bin", source, user)
        self.sockets = HostSockets(self.host.root)
        (self.host.root / "canary").write_text(Host.CANARY)
        (self.host.root / "canary").chmod(0o666)
        self.missing = set()
        self.use = None
        sanitized = b"__asan_init" in (self.host.programs / "myograded").read_bytes()
        self.memory_slack_mib = SANITIZED_SLACK_MIB if sanitized else MEMORY_SLACK_MIB
        self.honest = Honest(self.host, self.build / "policies" / "random")
        self.places = {
            "{tcp}": str(self.sockets.tcp.getsockname()[1]), "{unix}": self.sockets.unix_path,
            "{abstract}": self.sockets.name, "{canary}": str(self.host.root / "canary"),
            "{data}": str(self.host.data), "{store}": str(self.host.data / "store.db"),
            "{artefacts}": str(self.host.data / "artefacts"),
            "{sim}": str(self.build.resolve() / "bin" / "myograde-sim"),
            "{source}": str(pathlib.Path(source).resolve() / "configs" / "server.json"),
        }

    def __enter__(self):
        try:
            self.host.start()
            self.missing = self._lacking()
            self.honest.warm_up()
            self.use = self.host.daemon_use()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error):
        self.host.close()
        self.sockets.close()

    def _lacking(self):
        """The doctor's checks that are not ok on this host."""
        done = self.host.verb("doctor", "--json")
        checks = json.loads(done.stdout)["checks"]
        return {check["name"] for check in checks if check["state"] != "ok"}

    def folder(self, program, args):
        """A submission folder of a hostile program."""
        words = "-".join([program.split(".")[0], *args])
        folder = self.host.root / "programs" / "".join(
            c if c.isalnum() or c in "-_" else "_" for c in words)[:120]
        if folder.exists():
            return folder
        shutil.copytree(self.build / "policies" / "kit-python", folder)
        scripts = {"hostile.py", "honest.py"} | ({program} if program.endswith(".py") else set())
        for name in scripts:
            shutil.copy(HERE / "programs" / name, folder)
        command = ["/usr/bin/python3", program]
        if program.endswith(".c"):
            binary = program.removesuffix(".c")
            shutil.copy(self.build / "redteam" / binary, folder)
            command = [f"./{binary}"]
        (folder / "policy.json").write_text(json.dumps(
            {"name": "hostile", "command": command + [self.places.get(arg, arg) for arg in args],
             "runtimes": ["python"]}))
        return folder

    def submit(self, case, variant, args):
        return self.host.submit(self.folder(case.program, args), variant.track, "Hostile",
                                variant.episodes, variant.profile)

    def _play(self, case, variant):
        """Runs a variant and what belongs beside it; returns the mistakes."""
        running = [self.submit(case, variant, args)
                   for args in ((variant.beside, variant.args) if variant.beside
                                else (variant.args,))]
        mistakes = []
        for submission in running:
            status = self.host.wait(submission, END_S)
            if status is None:
                mistakes.append(f"it did not end in {END_S} s")
                self.host.verb("cancel", submission)
                continue
            mistakes += judge.mistakes(variant, status, self.host.result(submission), self.host,
                                       self.missing)
        return mistakes

    def _beside_honest(self, work):
        problems, stop = [], threading.Event()
        honest = threading.Thread(target=self.honest.beside, args=(stop, problems))
        honest.start()
        try:
            mistakes = work()
        finally:
            stop.set()
            honest.join()
        return mistakes + problems

    def after(self, clean_s):
        """What is wrong with the host after everything has ended."""
        left, spent, last = self.host.wait_clean(CLEAN_S)
        mistakes = [f"left: {thing}" for thing in left[:5]]
        if not left and spent > clean_s:
            mistakes.append(f"it took {spent:.1f} s until nothing was left; last: {last[:3]}")
        use = self.host.daemon_use()
        # It gives back what a crowd needed, every ten seconds.
        end = time.monotonic() + TRIMMED_S
        while (use["memory_mib"] > self.use["memory_mib"] + self.memory_slack_mib
               and time.monotonic() < end):
            time.sleep(0.5)
            use = self.host.daemon_use()
        if use["memory_mib"] > self.use["memory_mib"] + self.memory_slack_mib:
            mistakes.append(f"the daemon grew from {self.use['memory_mib']:.0f} to "
                            f"{use['memory_mib']:.0f} MiB")
        for what, slack in (("descriptors", DESCRIPTOR_SLACK), ("threads", DESCRIPTOR_SLACK)):
            if use[what] > self.use[what] + slack:
                mistakes.append(f"the daemon has {use[what]} {what}, at first {self.use[what]}")
        return mistakes

    def run_variant(self, case, variant):
        mistakes = []
        for _ in range(variant.repeat):
            mistakes += self._beside_honest(lambda: self._play(case, variant))
            mistakes += self.after(variant.clean_s)
        return [f"[{variant.name}] {text}" if variant.name else text for text in mistakes]

    def run(self, case):
        """The verdict on a case: ("PASS" | "FAIL" | "SKIP", words)."""
        if isinstance(case, submissions.SubmissionCase):
            mistakes = self._beside_honest(lambda: case.run(self)) + self.after(2.0)
            return ("FAIL", "; ".join(mistakes)) if mistakes else ("PASS", "")
        missing = sorted({check for variant in case.variants for check in variant.lacking
                          if check in self.missing})
        mistakes = [text for variant in case.variants for text in self.run_variant(case, variant)]
        if mistakes:
            return "FAIL", "; ".join(mistakes)
        if missing:
            return "SKIP", f"not on this host: missing {', '.join(missing)}"
        return "PASS", f"{len(case.variants)} variants" if len(case.variants) > 1 else ""
