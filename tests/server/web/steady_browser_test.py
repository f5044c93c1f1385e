"""In a headless Chromium: pages go on when the server was away, addresses that there are not, what leads to teams of
others, rows that are copied, and how long a token is kept."""

import json
import unittest

from browser_test import LIVE, TEAM, BrowserCase
from world import TRACK


class Steady(BrowserCase):
    def offline(self, page, away):
        page.call("Network.emulateNetworkConditions", offline=away, latency=0, downloadThroughput=-1,
                  uploadThroughput=-1)

    def test_pages_go_on_once_the_server_answers_again(self):
        made = self.world.submit(TEAM, "slow", episodes=40)
        submission, queue = self.page("participant"), self.page("participant")
        self.open(submission, f"/submission?id={made}")
        self.open(queue, "/queue", LIVE)
        for page in (submission, queue):
            self.offline(page, True)
        submission.wait("document.querySelector('h1 .live.lost')?.textContent === 'not connected'")
        self.world.ended(made)
        self.offline(submission, False)
        submission.wait("!!document.querySelector('.state.done') && document.querySelectorAll("
                        "'.cell[data-index]').length === 40 && document.querySelector('h1 .live').hidden", 40)
        # The stream that was open went on, as only new requests fail.
        queue.wait("document.querySelector('main').innerText.includes('Nothing of yours')")
        queue.call("Page.navigate", url=self.world.url + "/board")
        queue.wait("location.protocol === 'chrome-error:'")
        self.offline(queue, False)
        self.open(queue, "/queue", LIVE)

    def test_unknown_addresses_have_a_page_with_the_bar(self):
        page = self.page()
        for path, words in (("/boards", "There is no such page"), ("/docs/9.9/none.html", "The document is not here")):
            self.open(page, path)
            self.assertEqual(page.evaluate("document.querySelector('h1').textContent"), words)
            self.assertEqual(page.evaluate("document.querySelectorAll('nav[aria-label=Pages] a').length"), 5)
            self.check_accessible(page, path)

    def test_teams_of_others_can_be_followed_from_a_board(self):
        for role in ("public", "participant"):
            page = self.page(role)
            self.open(page, f"/board?track={TRACK}")
            page.evaluate("[...document.querySelectorAll('.board th a')].find((one) => one.textContent === "
                          "'Flexors United').click()")
            page.wait("location.pathname === '/team' && document.querySelector('main')?.dataset.ready === 'yes'")
            self.assertRegex(page.text(), r"4 of 5")
            self.check_quiet(page)

    def test_rows_are_copied_as_cells(self):
        page = self.page()
        self.open(page, f"/board?track={TRACK}")
        page.wait("document.querySelectorAll('.interval').length > 0")
        page.evaluate("getSelection().selectAllChildren(document.querySelector('.board'))")
        copied = page.evaluate("(() => {const data = new DataTransfer(); document.querySelector('.board')"
                               ".dispatchEvent(new ClipboardEvent('copy', {clipboardData: data, bubbles: true}));"
                               " return data.getData('text/plain'); })()")
        rows = [line.split("\t") for line in copied.split("\n")]
        self.assertEqual(rows[0][0], "Rank")
        self.assertEqual({len(row) for row in rows}, {len(rows[0])})
        self.assertEqual((len(rows), rows[1][:1], "Neon Tendons" in rows[1]), (6, ["1"], True))
        self.assertNotIn("Why?", copied)

    def test_a_token_may_stay_on_the_computer_and_its_end_is_told(self):
        made = self.world.post("/v1/tokens", {"role": "participant", "label": "test", "team": TEAM})
        page = self.page()
        self.open(page, "/sign-in")
        page.evaluate(f"document.getElementById('token').value = {json.dumps(made['token'])}")
        page.evaluate("document.getElementById('keep').click()")
        page.evaluate("document.querySelector('main form').requestSubmit()")
        page.wait("location.pathname === '/' && document.querySelector('#who')?.textContent.includes("
                  f"{json.dumps(TEAM)})")
        self.assertEqual(page.evaluate("[sessionStorage.length, localStorage.length]"), [0, 1])
        self.world.post(f"/v1/tokens/{made['id']}/revoke", {})
        self.open(page, "/")
        page.wait("document.querySelector('#who').textContent.includes('expired or was revoked')")
        self.assertEqual(page.evaluate("localStorage.length"), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
