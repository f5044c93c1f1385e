"""How the replay page reads files, keeps time and finds poses (replay_cases.mjs), by Node.js."""

import json
import os
import pathlib
import shutil
import struct
import subprocess
import tempfile
import unittest

import trajectories

HERE = pathlib.Path(__file__).parent
FILES = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"]) / "server/web/files"


def sample(frame):
    """What walk() has at a frame."""
    walk = trajectories.Walk(8.0)
    root = [channel[frame] for channel in walk.position[:3]]
    return {"frame": frame, "root": root, "arm": [root[0], root[1], root[2] + 0.3],
            "turn": [channel[frame] for channel in walk.rotation[:4]],
            "activation": walk.activation[0][frame], "distance": walk.distance[frame],
            "state": walk.states[frame], "contacts": walk.counts[frame]}


class Replay(unittest.TestCase):
    def test_modules_of_the_replay(self):
        self.assertIsNotNone(shutil.which("node"), "Node.js is missing: docker/packages.txt has it")
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            for file in (*FILES.glob("*.js"), HERE / "replay_cases.mjs"):
                shutil.copy(file, folder)
            (folder / "package.json").write_text('{"type": "module"}', encoding="utf-8")
            (folder / "walk.bin").write_bytes(trajectories.walk())
            walk = trajectories.Walk(8.0)
            (folder / "walk.json").write_text(json.dumps({
                "frames": walk.frames, "strongest": walk.strongest,
                "samples": [sample(frame) for frame in (0, 1, 77, 250, walk.frames - 1)],
                "terrain": {"row": 10, "column": 3, "height": walk.heights[10][3]}}),
                encoding="utf-8")
            model = trajectories.glb()
            length = struct.unpack_from("<I", model, 12)[0]
            scene = json.loads(model[20:20 + length])["scenes"][0]
            (folder / "extras.json").write_text(json.dumps(scene["extras"]), encoding="utf-8")
            done = subprocess.run(["node", "--test", "replay_cases.mjs"], cwd=folder, timeout=120,
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertRegex(done.stdout, r"# pass (1[6-9]|[2-9]\d)\n")


if __name__ == "__main__":
    unittest.main(verbosity=2)
