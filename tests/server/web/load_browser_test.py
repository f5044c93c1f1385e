"""Large boards, long evaluations, a long queue and many readers: pages stay quick, and so does grading.

It prints what it measures. The limits are for two cores. MYOGRADE_TEST_SLOWER multiplies them: 2, or 40 for
a build with sanitizers, which takes so much longer for JSON."""

import contextlib
import http.client
import json
import os
import threading
import time
import unittest
import urllib.parse

from browser_test import LIVE, TEAM, BrowserCase
from support.proc import cpu_seconds
from support.waiting import wait_until
from world import BIN, TRACK

SANITIZED = b"__asan_init" in (BIN / "myograded").read_bytes()
SLOWER = float(os.environ.get("MYOGRADE_TEST_SLOWER", "40" if SANITIZED else "2"))
READERS = 200
TABS = 10  # of the readers; a tab takes a hundred megabytes


class LoadCase(BrowserCase):
    settings = {"clients": 512, "block": 40}
    teams = 0

    def check_time(self, what, seconds, limit):
        print(f"{what}: {seconds:.2f} s", flush=True)
        self.assertLess(seconds, limit * SLOWER, what)

    def check_page(self, page, path, limit):
        """A page paints its first contents, and all of them, in time."""
        page.call("Page.navigate", url=self.world.url + path)
        page.wait("performance.getEntriesByName('shown').length > 0 && location.href === "
                  f"{json.dumps(self.world.url + path)}", 30 * SLOWER)
        paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
        shown = page.evaluate("performance.getEntriesByName('shown')[0].startTime")
        self.check_time(f"{path} is first painted", paint / 1000, 1)
        self.check_time(f"{path} is shown", shown / 1000, limit)
        self.check_quiet(page)

    def submit_many(self, count, mode_of, team_of, **more):
        """The numbers of so many submissions."""
        made = []
        def fill(part):
            for number in range(part, count, 4):
                made.append(self.world.submit(team_of(number), mode_of(number), **more))
        threads = [threading.Thread(target=fill, args=(part,)) for part in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(made), count)
        return made


class LargePages(LoadCase):
    settings = {"clients": 512, "block": 500}

    def test_a_board_of_500_teams(self):
        self.submit_many(500, lambda number: f"skill-{number % 40}-1-{number}-{number}",
                         lambda number: f"Team {number:03}")
        wait_until(lambda: self.world.get(f"/v1/leaderboard?track={TRACK}"), 1200,
                   "not all are ranked", fits=lambda board: len(board["rows"]) >= 500)
        page = self.page()
        self.check_page(page, f"/board?track={TRACK}", 3)
        self.assertGreaterEqual(page.evaluate("document.querySelectorAll('.board tbody th').length"),
                                500)
        self.check_page(page, "/", 3)

    def test_10000_episodes_are_shown_in_pages(self):
        made = self.world.submit(TEAM, "skill-5000-1-9-60", seeds=list(range(10000, 20000)))
        wait_until(lambda: self.world.get(f"/v1/submissions/{made}"), 1200, "it does not end",
                   fits=lambda status: status["state"] == "done")
        page = self.page("participant")
        self.check_page(page, f"/submission?id={made}", 3)
        self.assertEqual(page.evaluate("document.querySelectorAll('.cell[data-index]').length"), 500)
        page.evaluate("[...document.querySelectorAll('button')].find((one) => one.textContent === "
                      "'Next').click()")
        self.assertIn("Episodes 500 to 999", page.text())
        begin = time.monotonic()
        page.evaluate("document.querySelector('.cell[data-index]').click()")
        page.wait("document.querySelector('.details h3')?.textContent.startsWith('Episode 500:') && "
                  "!!document.querySelector('.details .facts')", 30 * SLOWER)
        self.check_time("one of the episodes is shown", time.monotonic() - begin, 1)


class LongQueue(LoadCase):
    def test_all_that_wait_are_counted_and_the_next_are_listed(self):
        count = 1300
        made = self.submit_many(count, lambda _: "stubborn", lambda number: f"Team {number % 40:02}",
                                episodes=40)
        wait_until(lambda: self.world.get("/v1/queue"), 60, "nothing runs",
                   fits=lambda view: view["running"] == 2)
        begin = time.monotonic()
        view = self.world.get("/v1/queue")
        self.check_time("a queue of 1,300 is answered", time.monotonic() - begin, 0.5)
        self.assertEqual(view["total"], count)
        self.assertEqual(len(view["submissions"]), 100)
        places = [entry["queue"]["position"] for entry in view["submissions"] if entry["queue"]]
        self.assertEqual(places, list(range(1, 99)))
        page = self.page("organiser")
        self.open(page, "/queue", LIVE)
        self.assertIn("1,200 more wait behind these.", page.text())
        self.check_quiet(page)
        own = self.page("participant")
        self.open(own, "/queue", LIVE)
        self.assertIn("Nothing of yours", own.text())
        for one in made:
            self.world.post(f"/v1/submissions/{one}/cancel", {})


class ManyReaders(LoadCase):
    def follow(self):
        """An answer that follows the queue as a page does; it has the connection."""
        url = urllib.parse.urlsplit(self.world.url)
        connection = http.client.HTTPConnection(url.hostname, url.port, timeout=30)
        connection.request("GET", "/v1/queue/events", headers={
            "Authorization": f"Bearer {self.world.tokens['participant']}"})
        answer = connection.getresponse()
        self.assertEqual(answer.status, 200)
        return answer

    def share(self, seconds=15):
        """How much of a core the daemon uses meanwhile, and the median of what others wait for."""
        begin, before, waits = time.monotonic(), cpu_seconds(self.world.pid), []
        while time.monotonic() - begin < seconds:
            asked = time.monotonic()
            self.world.get("/v1/live")
            waits.append(time.monotonic() - asked)
            time.sleep(0.25)
        used = cpu_seconds(self.world.pid) - before
        return used / (time.monotonic() - begin), sorted(waits)[len(waits) // 2]

    def test_200_open_pages_take_little_from_grading(self):
        with contextlib.ExitStack() as readers:
            made = self.world.submit(TEAM, "slow")
            alone, _ = self.share()
            first = self.page("participant")
            self.open(first, "/queue", LIVE)
            for _ in range(TABS - 1):
                self.open(self.page("participant"), "/queue", LIVE)
            for _ in range(READERS - TABS):
                readers.callback(self.follow().close)
            self.world.ended(made)
            made = [self.world.submit(TEAM, "slow", name=str(number)) for number in range(6)]
            watched, wait = self.share()
            print(f"the daemon uses {100 * alone:.1f} % of a core while it grades, and "
                  f"{100 * watched:.1f} % with {READERS} open pages", flush=True)
            # 5 % of two cores.
            self.assertLess(watched - alone, 0.1 * SLOWER)
            self.check_time("the median of other requests is answered", wait, 0.05)
            first.wait("document.querySelector('progress')?.value > 0", 120)
            for one in made:
                self.assertEqual(self.world.ended(one)["state"], "done")
        self.check_quiet(first)


if __name__ == "__main__":
    unittest.main(verbosity=2)
