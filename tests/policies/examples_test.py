"""The examples of training, as people run them: a rollout, a policy trained by PPO of
Stable-Baselines3, exported, and played at home, by `myograde local` and on a server, with the same
digests. Runs with docker/rl.txt (environments.sh)."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

from support.daemon import Daemon

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
EXAMPLES = SOURCE / "policies/python/examples"
EPISODES = 2
DEADLINE_S = 240


def run(*words, **variables):
    """What an example prints. Programs of the grader are not for the libraries of this test."""
    done = subprocess.run([sys.executable, "-B", *map(str, words)], text=True, timeout=DEADLINE_S,
                          capture_output=True, env={**os.environ, **variables}, check=False)
    if done.returncode != 0:
        raise AssertionError(f"{words}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def without_preload():
    """The grader's programs bring their own sanitizer."""
    return {key: value for key, value in os.environ.items()
            if key not in ("LD_PRELOAD", "GLIBC_TUNABLES", "ASAN_OPTIONS")}


class Examples(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="myograde-examples-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.folder.chmod(0o755)

    def test_a_random_rollout_and_its_picture(self):
        picture = self.folder / "last.ppm"
        lines = run(EXAMPLES / "random_rollout.py", "--episodes", 2, "--picture",
                    picture).splitlines()
        self.assertEqual(len(lines), 2)
        for seed, line in enumerate(lines):
            self.assertRegex(line, rf"^seed {seed}: \w+ after \d+ steps, reward -?\d+\.\d$")
        self.assertTrue(picture.read_bytes().startswith(b"P6 640 480 255\n"))
        self.assertEqual(picture.stat().st_size, len("P6 640 480 255\n") + 640 * 480 * 3)

    def test_many_environments_train_by_stable_baselines(self):
        import numpy as np
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecMonitor
        from myograde.envs.sb3 import StableVecEnv

        envs = StableVecEnv("myograde/Elbow-v0", 3, threads=2, max_episode_steps=20)
        envs.seed(7)
        envs.reset()
        self.assertEqual([info["seed"] for info in envs.reset_infos], [7, 8, 9])
        for step in range(20):
            observations, rewards, done, infos = envs.step(np.full((3, 6), 0.5))
        self.assertEqual((done.tolist(), observations.shape), ([True] * 3, (3, 9)))
        for i, info in enumerate(infos):
            self.assertEqual((info["seed"], info["steps"], info["end"]), (7 + i, 20, "time"))
            self.assertEqual((info["episode"]["l"], info["TimeLimit.truncated"]), (20, True))
            self.assertFalse(np.array_equal(info["terminal_observation"], observations[i]))
        model = PPO("MlpPolicy", VecMonitor(envs), n_steps=64, batch_size=64, device="cpu", seed=1)
        model.learn(192)
        self.assertGreater(len(model.ep_info_buffer), 5)

    def test_a_trained_policy_has_the_same_digests_at_home_by_local_and_on_a_server(self):
        model, submission = self.folder / "elbow_ppo.zip", self.folder / "elbow-ppo"
        run(EXAMPLES / "train_ppo.py", "--steps", 2048, "-o", model)
        run(EXAMPLES / "export_policy.py", model, submission)
        at_home = [json.loads(line) for line in
                   run(EXAMPLES / "play_at_home.py", submission, "--episodes",
                       EPISODES).splitlines()]
        home = [(row["digest"], row["actions_digest"]) for row in at_home]
        self.assertEqual(len(set(home)), EPISODES)
        self.assertEqual(self.local(submission), home)
        self.assertEqual(self.server(submission), home)
        self.check_the_export_is_the_trained_network(model, submission)

    def local(self, submission):
        said = subprocess.run(
            [BIN / "myograde", "local", submission, "--track", "elbow", "--episodes",
             str(EPISODES), "--json"], env=without_preload(), timeout=DEADLINE_S,
            capture_output=True, text=True, check=False)
        self.assertEqual(said.returncode, 0, said.stdout + said.stderr)
        return [(row["digest"], row["actions_digest"])
                for row in json.loads(said.stdout)["episodes"]]

    def server(self, submission):
        with Daemon(BIN, SOURCE, "examples") as daemon:
            for name in ("LD_PRELOAD", "GLIBC_TUNABLES", "ASAN_OPTIONS"):
                daemon.environment.pop(name, None)
            daemon.change_config("tracks/elbow.json", episodes_per_lease=EPISODES,
                                 seeds={"first": 0, "count": EPISODES})
            daemon.start()
            accepted = daemon.ask("submit", submission, "--team", "examples", "--track", "elbow",
                                  "--wait")
            shown = daemon.ask("show", accepted["submission"], "--episodes")
            return [(row["digest"], row["actions_digest"]) for row in shown["episode_rows"]]

    def check_the_export_is_the_trained_network(self, model, submission):
        script = ("import sys, importlib.util, numpy as np\n"
                  "from stable_baselines3 import PPO\n"
                  "sys.path.insert(0, sys.argv[2])\n"
                  "import network\n"
                  "model = PPO.load(sys.argv[1], device='cpu')\n"
                  "own = network.of_folder(sys.argv[2])\n"
                  "size = own.layers[0][0].shape[1]\n"
                  "for seed in range(100):\n"
                  "    values = np.random.default_rng(seed).normal(0, 2, size)\n"
                  "    theirs, _ = model.predict(values, deterministic=True)\n"
                  "    np.testing.assert_allclose(own.act(values), theirs, atol=1e-5)\n")
        run("-c", script, model, submission)

    def test_mistakes_are_told_in_a_sentence(self):
        for words, sentence in ((("export_policy.py", "none.zip", "out"), "there is no file"),
                                (("random_rollout.py", "--environment", "x"), "invalid choice")):
            done = subprocess.run([sys.executable, "-B", EXAMPLES / words[0], *words[1:]],
                                  cwd=self.folder, text=True, timeout=DEADLINE_S,
                                  capture_output=True, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(sentence, done.stderr)


if __name__ == "__main__":
    unittest.main()
