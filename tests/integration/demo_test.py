"""./dev demo shows what its headings say: who is ahead on each board, and what became of whose episodes."""

import os
import pathlib
import re
import subprocess
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
LONGEST_S = 3000  # with a build that finds nothing in a compiler cache
BOARDS = {"elbow": ("Scripted team", "Random team"),
          **{track: ("Baseline team", "Zero team") for track in ("reorientation", "baoding", "relocation")},
          **{track: ("Baseline team", "Random team") for track in ("demo-manipulation", "demo-locomotion")}}


class Demo(unittest.TestCase):
    def test_each_heading_is_followed_by_what_it_says(self):
        done = subprocess.run(["./dev", "demo"], cwd=SOURCE, capture_output=True, text=True, timeout=LONGEST_S,
                              check=False)
        self.assertEqual(done.returncode, 0, done.stdout[-2000:] + done.stderr[-2000:])
        sections = re.findall(r"^== (.*)\n((?:(?!== ).*\n)*)", done.stdout, re.MULTILINE)

        def below(heading):
            found = [text for title, text in sections if title.startswith(heading)]
            self.assertEqual(len(found), 1, f"{heading}: {[title for title, _ in sections]}")
            return found[0]

        for track, (ahead, behind) in BOARDS.items():
            with self.subTest(track):
                board = below(f"Leaderboard of {track}")
                self.assertLess(board.index(ahead), board.index(behind))
        self.assertIn("demo-manipulation", below("What became of each box"))
        self.assertRegex(below("An organiser marks the walker"), r"(?m)^base +Baseline team ")
        for track in ("locomotion", "chasetag"):
            played = below(f"Five practice episodes of the whole track {track}")
            self.assertEqual(len(re.findall(r"(?m)^ +\d+ +\d+ +(?:success|failure) ", played)), 5, played)


if __name__ == "__main__":
    unittest.main()
