"""Pictures of the graded environments in Python. Runs with Gymnasium (environments.sh)."""

import concurrent.futures
import os
import subprocess
import sys
import unittest

import gymnasium
import numpy as np

import myograde.envs
from myograde import errors

SIZE = {"width": 64, "height": 48}


def make(name="myograde/Elbow-v0", **settings):
    return gymnasium.make(name, **{"render_mode": "rgb_array", **SIZE, **settings})


class Pictures(unittest.TestCase):
    def test_each_track_draws_what_it_plays(self):
        for name in myograde.envs.ENVIRONMENTS:
            with self.subTest(name):
                env = make(name)
                self.assertEqual(env.metadata["render_modes"], ["rgb_array"])
                self.assertEqual(env.metadata["render_fps"],
                                 round(1 / env.unwrapped.core.control_period_s))
                env.reset(seed=1)
                first = env.render()
                self.assertEqual((first.shape, first.dtype), ((48, 64, 3), np.uint8))
                self.assertGreater(len(np.unique(first.reshape(-1, 3), axis=0)), 100)
                np.testing.assert_array_equal(env.render(), first)
                for _ in range(4):
                    env.step(env.action_space.high)
                self.assertFalse(np.array_equal(env.render(), first))
                env.close()

    def test_drawing_changes_no_digest(self):
        digests = set()
        for settings in ({}, {"render_mode": None}):
            env = make(**settings)
            env.reset(seed=3)
            ended = False
            for step in range(10**6):
                if step % 30 == 0:
                    env.render()
                *_, terminated, truncated, info = env.step(env.action_space.low)
                if terminated or truncated:
                    break
            digests.add(info["digest"])
        self.assertEqual(len(digests), 1)

    def test_a_camera_looks_from_elsewhere(self):
        pictures = []
        for camera in ({}, {"azimuth": 180}, {"body": "", "look_at": (0.0, 0.0, 1.0),
                                              "distance": 3, "elevation": -40.0}):
            env = make(camera=camera)
            env.reset(seed=1)
            pictures.append(env.render())
        self.assertFalse(np.array_equal(pictures[0], pictures[1]))
        self.assertFalse(np.array_equal(pictures[0], pictures[2]))

    def test_what_can_not_be_drawn_is_refused_with_a_sentence(self):
        for settings, sentence in (
                ({"camera": {"zoom": 2}}, 'a camera has no "zoom"; it has: body, '),
                ({"camera": {"body": "tail"}}, "no body tail"),
                ({"width": 0}, "width=0 .*from 1 to 4096"),
                ({"height": 100000}, "from 1 to 4096"),
                ({"camera": {"look_at": "up"}}, "three finite numbers")):
            with self.subTest(str(settings)), self.assertRaisesRegex(errors.WrongUse, sentence):
                env = make(**settings).unwrapped
                env.reset(seed=1)
                env.render()
        with self.assertRaisesRegex(errors.WrongUse, "before the first reset"):
            make().unwrapped.render()
        with self.assertRaisesRegex(errors.WrongUse, 'render_mode="ansi" is unknown'):
            myograde.envs.GradedEnv("elbow", render_mode="ansi")

    def test_a_forked_process_draws_and_ends(self):
        script = """
import os, sys, gymnasium, myograde.envs
def make():
    env = gymnasium.make("myograde/Elbow-v0", render_mode="rgb_array", width=64, height=48)
    env.reset(seed=1)
    return env
env = make()
print(env.render().sum(), os.environ.get("LP_NUM_THREADS"), flush=True)
if "closed" in sys.argv:
    env.close()
child = os.fork()
ended = os.waitpid(child, 0)[1] if child else 0
picture = (make() if child == 0 and "own" in sys.argv else env).render()
print(picture.sum(), flush=True)
sys.exit(os.waitstatus_to_exitcode(ended))
"""
        for words in (["own"], ["own", "closed"], []):
            # Both end by themselves, as a process does.
            said = subprocess.run([sys.executable, "-B", "-c", script, *words], text=True, timeout=60,
                                  capture_output=True, env={**os.environ, "LP_NUM_THREADS": "3"})
            self.assertEqual(said.returncode, 0, said.stderr)
            first, kept, *others = said.stdout.split()
            self.assertEqual((kept, others), ("3", [first] * 2), words)

    def test_threads_draw_environments_of_their_own(self):
        def play(seed):
            env = make()
            env.reset(seed=seed)
            first = env.render()
            return all(np.array_equal(env.render(), first) for _ in range(2))

        with concurrent.futures.ThreadPoolExecutor(3) as threads:
            self.assertEqual(list(threads.map(play, range(3))), [True] * 3)

    def test_record_video_takes_the_pictures(self):
        env = gymnasium.wrappers.RenderCollection(make())
        env.reset(seed=1)
        for _ in range(3):
            env.step(env.action_space.low)
        frames = env.render()
        self.assertEqual([frame.shape for frame in frames], [(48, 64, 3)] * 4)


if __name__ == "__main__":
    unittest.main()
