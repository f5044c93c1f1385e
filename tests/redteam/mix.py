"""Hostile and honest submissions mixed at random for some time, on all slots. Afterwards nothing
may be left, memory must be flat, and all honest results must be equal, byte for byte."""

import json
import random
import threading
import time

import judge
import submissions
import suite as suites

RESTS_S = (0.0, 0.0, 0.0, 0.2, 1.0)
PROGRESS_S = 10
AT_ONCE = 3  # concurrent submissions: one for each slot of the suite's daemon


class Mixture:
    """What was played, and what was wrong with it. Shared by all threads."""

    def __init__(self, suite, seed, seconds):
        self.suite = suite
        self.random = random.Random(seed)
        self.end = time.monotonic() + seconds
        self.lock = threading.Lock()
        self.hostile = self.honest = 0
        self.mistakes = []
        self.variants = [(case, variant) for case in suites.all_cases()
                         if not isinstance(case, submissions.SubmissionCase)
                         for variant in case.variants if not variant.beside]

    def say(self, text):
        with self.lock:
            self.mistakes.append(text)
            print(f"FAIL {text}", flush=True)

    def play_hostile(self):
        host = self.suite.host
        with self.lock:  # two threads must not create the same folder
            case, variant = self.random.choice(self.variants)
            self.suite.folder(case.program, variant.args)
        submission = self.suite.submit(case, variant, variant.args)
        status = host.wait(submission, suites.END_S)
        self.hostile += 1
        if status is None:
            return self.say(f"{case.number} {variant.name}: it did not end")
        wrong = judge.mistakes(variant, status, host.result(submission), host, self.suite.missing)
        for text in wrong:
            self.say(f"{case.number} {variant.name}: {text}")
        return None

    def play_honest(self):
        if self.suite.honest.play() != self.suite.honest.alone:
            self.say("an honest submission got another result")
        self.honest += 1

    def work(self, honest):
        while time.monotonic() < self.end:
            try:
                if honest or self.random.random() < 0.3:
                    self.play_honest()
                else:
                    self.play_hostile()
            except (RuntimeError, OSError, KeyError) as trouble:
                self.say(f"{trouble}")
            time.sleep(self.random.choice(RESTS_S))


def run(seconds, seed, build, source, user, as_json):
    """Exit status 1 if anything was wrong."""
    with suites.Suite(build, source, user) as suite:
        before = suite.use
        mixture = Mixture(suite, seed, seconds)
        threads = [threading.Thread(target=mixture.work, args=(i == 0,)) for i in range(AT_ONCE)]
        for thread in threads:
            thread.start()
        while working := [thread for thread in threads if thread.is_alive()]:
            working[0].join(PROGRESS_S)
            if not as_json:
                print(f"  {mixture.hostile} hostile, {mixture.honest} honest, "
                      f"{max(0, mixture.end - time.monotonic()):.0f} s to go, daemon "
                      f"{suite.host.daemon_use()['memory_mib']:.0f} MiB", flush=True)
        for text in suite.after(suites.CLEAN_S):
            mixture.say(text)
        use = suite.host.daemon_use()
    summary = {"hostile": mixture.hostile, "honest": mixture.honest, "seconds": seconds,
               "mistakes": mixture.mistakes, "daemon_before": before, "daemon_after": use}
    if as_json:
        print(json.dumps(summary, indent=1))
    else:
        print(f"mixture: {mixture.hostile} hostile and {mixture.honest} honest submissions in "
              f"{seconds} s, {len(mixture.mistakes)} mistakes; the daemon's memory went from "
              f"{before['memory_mib']:.0f} to {use['memory_mib']:.0f} MiB")
    return 1 if mixture.mistakes or not mixture.hostile or not mixture.honest else 0
