"""What a run without a daemon leaves to look at: logs, films, a report."""

from system import POLICIES, SystemTest, track_config


class LocalEpisodes(SystemTest):
    """What a local run leaves to look at."""

    tracks = {"short-arm": track_config("manipulation", rules={"max_steps": 60})}

    def test_an_episode_with_carried_over_state_is_played_from_the_files_beside_it(self):
        logs = self.root / "logs"
        graded = self.ask("local", POLICIES / "zero", "--track", "short-arm", "--profile", "as-graded",
                          "--logs", logs)
        names = [f"episode-00{number}.lcmlog.zst" for number in range(3)]
        self.assertEqual([row["log"]["file"] for row in graded["episode_rows"]], names)
        self.assertEqual(graded["episodes"], graded["episode_rows"])
        self.assertEqual(sorted(file.name for file in logs.iterdir()), names)
        last = logs / names[2]
        replayed = self.ask("episode", "replay", last)
        self.assertEqual((replayed["equal"], [one["index"] for one in replayed["episodes"]]), (True, [2]))
        for words in ((), ("--strip",)):
            shown = self.ask("episode", "render", last, "-o", self.root / "shown.png", "--size", "64x48", *words)
            self.assertEqual([one["index"] for one in shown["episodes"]], [2])
        # Under other names of the same form, too.
        other = self.root / "other"
        other.mkdir()
        for number, name in enumerate(names):
            (other / f"run7-{number}.lcmlog.zst").write_bytes((logs / name).read_bytes())
        self.assertTrue(self.ask("episode", "replay", other / "run7-2.lcmlog.zst")["equal"])
        (other / "run7-1.lcmlog.zst").write_bytes((logs / names[0]).read_bytes())
        (logs / names[1]).unlink()
        (other / "log.lcmlog.zst").write_bytes(last.read_bytes())
        for file, sentence in ((last, f"{names[1]} is missing"),
                               (other / "run7-2.lcmlog.zst", "is not the log of episode 1"),
                               (other / "log.lcmlog.zst", "name each log after its episode")):
            for words in (("episode", "replay", file), ("episode", "render", file, "-o", self.root / "none.png")):
                refused = self.run_cli(*words, check=False)
                self.assertEqual(refused.returncode, 2, refused.stdout)
                self.assertIn(sentence, refused.stderr)
        # The first of its lease needs no other.
        self.assertTrue(self.ask("episode", "replay", logs / names[0])["equal"])

    def test_a_policy_is_tried_with_one_command(self):
        folder = self.root / "tried"
        told = self.ask("try", POLICIES / "scripted-elbow", "--episodes", 2, "-o", folder)
        self.assertEqual((told["result"]["track"], told["result"]["state"]), ("elbow", "done"))
        self.assertEqual([film["place"] for film in told["films"]], ["best", "worst"], told["missing"])
        for film in told["films"]:
            head = (folder / film["file"]).read_bytes()[:8]
            self.assertTrue(head[4:] == b"ftyp" or head.startswith(b"\x89PNG"), head)
        self.assertEqual(len(list((folder / "logs").iterdir())), 2)
        if told["report"] is None:
            self.assertIn("matplotlib", " ".join(told["missing"]))
        else:
            self.assertEqual(told["open"], str(folder / "report.html"))
            self.assertIn("Local run: scripted-elbow", (folder / "report.html").read_text())
        again = self.run_cli("try", POLICIES / "scripted-elbow", "-o", folder, check=False)
        self.assertEqual(again.returncode, 2)
        self.assertIn("is not empty", again.stderr)
        # Nothing stays of a run that can't begin.
        self.assertEqual(self.run_cli("try", self.root / "none", "-o", self.root / "new", check=False).returncode, 2)
        self.assertFalse((self.root / "new").exists())
