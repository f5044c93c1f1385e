"""The shipped recipes of PyTorch and JAX, made by `myograde runtime add`, and policies graded with
them. Skipped where PyPI or Debian's packages can't be reached."""

import json
import subprocess
import time

from system import BIN, SystemTest, track_config

TRACK = "runtimes"
REACHING_S = 1800
PLAYER = """import myograde
{imports}

class Network(myograde.Policy):
    def start(self):
        self.size = self.welcome.action_size
{start}

    def act(self, observation):
{act}

print("module", {module}.__file__, {module}.__version__, flush=True)
myograde.serve(Network())
"""
TORCH = {
    "imports": "import torch",
    "start": """        torch.manual_seed(7)
        self.net = torch.nn.Sequential(torch.nn.Linear(self.welcome.observation_size, 32),
                                       torch.nn.Tanh(), torch.nn.Linear(32, self.size))""",
    "act": """        with torch.no_grad():
            values = torch.tensor(list(observation), dtype=torch.float32)
            return torch.tanh(self.net(values)).tolist()""",
    "module": "torch"}
JAX = {
    "imports": "import jax\nimport jax.numpy as jnp",
    "start": """        key = jax.random.PRNGKey(7)
        weights = jax.random.normal(key, (self.size, self.welcome.observation_size)) * 0.1
        self.net = jax.jit(lambda values: jnp.tanh(weights @ values))
        self.net(jnp.zeros(self.welcome.observation_size))""",
    "act": """        values = jnp.asarray(list(observation), dtype=jnp.float32)
        return [float(x) for x in self.net(values)]""",
    "module": "jax"}


class HeavyRuntimes(SystemTest):
    tracks = {TRACK: track_config(
        "elbow", budgets={"startup_s": 120, "startup_wall_s": 600, "step_s": 1, "overtime_s": 5,
                          "wall_factor": 4})}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.daemon.configure(runtimes_dir=str(cls.root / "runtimes"))
        cls.start_daemon()

    def check(self, runtime, parts):
        made = subprocess.run([BIN / "myograde", "runtime", "add", runtime], env=self.environment,
                              capture_output=True, text=True, timeout=REACHING_S, check=False)
        if made.returncode == 4 and ("Could not" in made.stderr or "Unable" in made.stderr
                                     or "Failed to fetch" in made.stderr):
            self.skipTest(made.stderr.strip())
        self.assertEqual(made.returncode, 0, made.stderr)
        folder = self.python_policy(f"plays-{runtime}", ["policy.py"])
        (folder / "policy.py").write_text(PLAYER.format(**parts), encoding="utf-8")
        manifest = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps({**manifest, "runtimes": [runtime]}))
        roots = []
        for team in ("first", "second"):
            number = self.ask("submit", folder, "--track", TRACK, "--team", team)["submission"]
            shown = self.result(str(number))
            self.assertEqual(shown["state"], "done", shown)
            self.assertIn(f"/runtimes/{runtime}@", json.dumps(shown["output"]))
            self.assertEqual(len(shown["grader"]["runtimes"][runtime]), 64)
            roots.append(shown["merkle_root"])
        self.assertEqual(roots[0], roots[1], "it is not repeatable")

    def result(self, submission):
        end = time.monotonic() + 900
        while time.monotonic() < end:
            if self.ask("status", submission)["state"] in ("done", "failed", "grader_error"):
                return self.ask("show", submission)
            time.sleep(1)
        self.fail("no end in time")

    def test_torch(self):
        self.check("torch-cpu", TORCH)

    def test_jax(self):
        self.check("jax", JAX)
