"""A lease's end on a node of a cluster, without a cluster: the same records and logs as the runner alone
gives, and an end in time whatever happens to the daemon or the job."""

import json
import os
import pathlib
import pwd
import shutil
import signal
import subprocess
import tarfile
import tempfile
import time
import unittest

from system import BIN, POLICIES, SOURCE, track_config

ROOT = os.geteuid() == 0
UID_BASE = 500000 + os.getpid() % 10000 * 8192 if ROOT else -1
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
# Of a host and its load, not of the lease.
LOAD = {"policy_cpu_s", "simulator_cpu_s", "wall_s", "peak_memory_bytes", "cpu_s"}


def without_load(value):
    if isinstance(value, dict):
        return {key: without_load(entry) for key, entry in value.items()
                if key not in LOAD and "wall" not in key and "cpu" not in key}
    return [without_load(entry) for entry in value] if isinstance(value, list) else value


def records(lines):
    """All records but those of progress."""
    return [without_load(record) for record in map(json.loads, lines)
            if record["type"] != "progress"]


class Lease:
    """The other end of a node's lease, which talks with it as the daemon's host does."""

    def __init__(self, world, number, policy, track, episodes):
        self.work = world.root / f"work-{number}"
        self.work.mkdir()
        world.run_checked([world.tool, policy, track, episodes, CACHE, UID_BASE, self.work])
        self.order = json.loads((self.work / "cluster.json").read_text())
        self.nodes, self.lines, self.logs, self.end = [], [], {}, None
        self.wanted = 0

    def start(self, world, **environment):
        self.node = subprocess.Popen(
            [BIN / "myograde-node", "--play", "--cache", CACHE, "--node-dir",
             world.root / "node-dir"],
            env={**world.environment, **environment}, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        return self

    def say(self, kind, data=b""):
        self.node.stdin.write(b"%s %d\n%s\n" % (kind.encode(), len(data), data))
        self.node.stdin.flush()

    def hear(self):
        """The next message's kind, which is answered; None at the end."""
        head = self.node.stdout.readline().split()
        if not head:
            return None
        kind, data = head[0].decode(), self.node.stdout.read(int(head[1]))
        assert self.node.stdout.read(1) == b"\n"
        if kind == "node":
            self.nodes.append(json.loads(data))
            if len(self.nodes) == 1:
                self.say("order", json.dumps(self.order).encode())
        elif kind == "want":
            self.wanted += 1
            self.send_artefact()
        elif kind == "record":
            self.lines.append(data.decode())
        elif kind == "log":
            name, _, log = data.partition(b"\n")
            self.logs[name.decode() + ".lcmlog.zst"] = log
        else:
            assert kind == "end", kind
            self.end = json.loads(data)
            if self.end["record"]:
                self.lines.append(self.end["record"])
        return kind

    def send_artefact(self):
        with tempfile.TemporaryFile() as tar:
            with tarfile.open(fileobj=tar, mode="w", format=tarfile.PAX_FORMAT) as archive:
                for path in sorted((self.work / "policy").rglob("*")):
                    archive.add(path, path.relative_to(self.work / "policy"), recursive=False)
            tar.seek(0)
            while piece := tar.read(100_000):
                self.say("data", piece)
            self.say("data")

    def play(self):
        """To its end; the exit status."""
        while self.hear() is not None:
            pass
        return self.close()

    def until_it_plays(self):
        while not self.lines:
            assert self.hear() is not None, self.node.stderr.read()

    def close(self):
        status = self.node.wait(60)
        self.said = self.node.stderr.read().decode()
        self.close_streams()
        return status

    def close_streams(self):
        for stream in (self.node.stdin, self.node.stdout, self.node.stderr):
            stream.close()


class Node(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-node-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.root, ignore_errors=True)
        cls.root.chmod(0o755)
        cls.tool = BIN.parent / "tests/node_order"
        configs = cls.root / "configs"
        shutil.copytree(SOURCE / "configs", configs)
        (configs / "tracks/short.json").write_text(json.dumps(track_config("elbow")))
        (configs / "tracks/patient.json").write_text(json.dumps(
            track_config("elbow", budgets={"startup_s": 600})))
        cls.environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith("SLURM")},
            "MYOGRADE_CONFIG_DIR": str(configs), "MYOGRADE_BIN_DIR": str(BIN)}
        cls.numbers = iter(range(1, 1000))
        cls.policies = {}
        for name, program in (("sleeps", "#!/bin/sh\nexec sleep 1000\n"),
                              ("ends", "#!/bin/sh\necho last words >&2\nexit 7\n")):
            cls.policies[name] = cls.root / name
            cls.policies[name].write_text(program)
            cls.policies[name].chmod(0o755)
        cls.policies["scripted"] = POLICIES / "scripted-elbow"

    @classmethod
    def run_checked(cls, words):
        done = subprocess.run([*map(str, words)], env=cls.environment, capture_output=True,
                              text=True, timeout=300, stdin=subprocess.DEVNULL)
        if done.returncode != 0:
            raise AssertionError(done.stdout + done.stderr)
        return done.stdout

    def lease(self, policy, episodes=3, **environment):
        """A lease whose node has begun; it is dead when the test is over."""
        track = "patient" if policy == "sleeps" else "short"
        lease = Lease(self, next(self.numbers), self.policies[policy], track, episodes)
        return self.begin(lease, **environment)

    def begin(self, lease, **environment):
        lease.start(self, **environment)
        self.addCleanup(lease.close_streams)
        self.addCleanup(lease.node.wait)
        self.addCleanup(lease.node.kill)
        return lease

    def alone(self, lease):
        """What the runner alone prints for the same lease."""
        said = self.run_checked([BIN / "myograde-runner", lease.work / "order.json"])
        return records(said.splitlines())

    def check_ends(self, lease, words):
        begin = time.monotonic()
        while lease.hear() is not None:
            pass
        lease.close()
        self.assertLess(time.monotonic() - begin, 15)
        self.assertIsNone(lease.end)
        self.assertIn(words, lease.said)
        self.assertEqual([], [line for line in lease.lines
                              if json.loads(line)["type"] == "lease_end"])

    def test_plays_a_lease_as_the_runner_does(self):
        lease = self.lease("scripted", SLURMD_NODENAME="n1", SLURM_JOB_ID="12")
        self.assertEqual(lease.play(), 0, lease.said)
        self.assertEqual(records(lease.lines), self.alone(lease))
        self.assertEqual(sum(record["type"] == "episode" for record in records(lease.lines)), 3)
        self.assertEqual(lease.logs, {path.name: path.read_bytes()
                                      for path in (lease.work / "logs").iterdir()})
        self.assertEqual(len(lease.logs), 3)
        self.assertEqual({(node["node"], node["job"]) for node in lease.nodes}, {("n1", "12")})
        self.assertTrue(lease.nodes[-1]["processor"])
        self.assertGreater(lease.nodes[-1]["cpu_s"], 0)
        self.assertEqual(lease.end["wait_status"], 0)
        self.assertEqual(json.loads(lease.end["record"])["type"], "lease_end")
        work = self.root / "node-dir/work"
        self.assertEqual([], [*work.iterdir()] if work.exists() else [])
        # A submission comes once, and a node proves itself once.
        again = self.lease("scripted")
        begin = time.monotonic()
        again.until_it_plays()
        quick = time.monotonic() - begin
        self.assertEqual(again.play(), 0)
        self.assertEqual(again.wanted, 0)
        proves = Lease(self, next(self.numbers), self.policies["scripted"], "short", 1)
        proves.order["prove_again"] = ["n7"]
        self.begin(proves, SLURMD_NODENAME="n7")
        begin = time.monotonic()
        proves.until_it_plays()
        self.assertGreater(time.monotonic() - begin, quick)
        self.assertEqual(proves.play(), 0)

    def test_a_policy_that_fails_fails_as_it_does_everywhere(self):
        lease = self.lease("ends")
        self.assertEqual(lease.play(), 0, lease.said)
        self.assertEqual(records(lease.lines), self.alone(lease))

    def test_a_runner_that_prints_no_record_is_a_fault_of_the_graders(self):
        self.assertEqual(self.lease("scripted", episodes=1).play(), 0)  # the node proves itself
        programs = self.root / "programs"
        programs.mkdir()
        for program in BIN.iterdir():
            (programs / program.name).symlink_to(program)
        runner = programs / "myograde-runner"
        runner.unlink()
        runner.write_text("#!/bin/sh\necho nonsense\nexec sleep 1000\n")
        runner.chmod(0o755)
        lease = self.lease("scripted", MYOGRADE_BIN_DIR=str(programs))
        self.assertEqual(lease.play(), 0, lease.said)
        self.assertNotIn("lost", lease.nodes[-1])
        self.assertEqual(lease.end["record"], "")
        self.assertIn("printed a malformed record", lease.end["said"])

    def test_two_leases_share_a_node_and_each_ends_with_its_srun(self):
        leases = [self.lease("sleeps") for _ in range(2)]
        for lease in leases:
            lease.until_it_plays()
        self.assertEqual(len([*(self.root / "node-dir/work").iterdir()]), 2)
        leases[0].node.stdin.close()
        leases[0].node.wait(60)
        self.assertEqual(len([*(self.root / "node-dir/work").iterdir()]), 1)
        leases[1].node.stdin.close()
        for lease in leases:
            self.check_ends(lease, "its srun is gone")
        self.assertEqual([], [*(self.root / "node-dir/work").iterdir()])

    def test_sigterm_ends_it_and_is_told(self):
        lease = self.lease("sleeps")
        lease.until_it_plays()
        lease.node.send_signal(signal.SIGTERM)
        self.check_ends(lease, "preempted, cancelled or at its time limit")

    def test_a_node_whose_grader_differs_refuses(self):
        lease = Lease(self, next(self.numbers), self.policies["scripted"], "short", 1)
        grader = json.loads(lease.order["grader"])
        grader["simulator"] = "0" * 64
        lease.order["grader"] = json.dumps(grader)
        self.assertEqual(self.begin(lease).play(), 0)
        self.assertIn("its simulator is", lease.nodes[-1]["unfit"])
        self.assertIn("its simulator is", lease.nodes[-1]["lost"])
        self.assertEqual(lease.lines, [])

    def test_a_submission_that_was_changed_on_its_way_is_not_played(self):
        lease = Lease(self, next(self.numbers), self.policies["ends"], "short", 1)
        (lease.work / "policy/ends").write_text("#!/bin/sh\nexit 8\n")
        digest = lease.order["artefact"]
        # Unlike every other's, so that the node has not unpacked it yet.
        lease.order["artefact"] = ("0" if digest[0] != "0" else "1") + digest[1:]
        self.assertEqual(self.begin(lease).play(), 0)
        self.assertIn("the submission did not reach it", lease.nodes[-1]["lost"])
        self.assertTrue(lease.nodes[-1]["blamed"])
        self.assertEqual(lease.lines, [])
        self.assertEqual([], [path for path in (self.root / "node-dir/artefacts").iterdir()
                              if path.name in (lease.order["artefact"],
                                               lease.order["artefact"] + ".part")])

    def test_what_is_no_order_is_refused_in_a_sentence(self):
        lease = Lease(self, next(self.numbers), self.policies["ends"], "short", 1)
        lease.order["artefact"] = "../../etc"
        self.assertEqual(self.begin(lease).play(), 4)
        self.assertIn("myograde-node: a cluster's order: artefact: is not a digest", lease.said)
        for words in (["--play", "--cache"], ["--lifeline"], ["--prove"], []):
            done = subprocess.run([BIN / "myograde-node", *words], capture_output=True, text=True,
                                  check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn("usage: myograde-node", done.stderr)

    @unittest.skipUnless(ROOT, "only root can become another user")
    def test_a_users_home_is_found_without_an_environment(self):
        """A job of a cluster has none."""
        nobody = pwd.getpwnam("nobody")
        done = subprocess.run(
            ["setpriv", f"--reuid={nobody.pw_uid}", f"--regid={nobody.pw_gid}", "--clear-groups", "env",
             "-i", BIN / "myograde-node", "--play"], stdin=subprocess.DEVNULL, capture_output=True,
            text=True, check=False)
        if done.returncode in (126, 127):
            self.skipTest(f"nobody can't run it: {done.stderr}")
        self.assertEqual(done.returncode, 4)
        self.assertIn(f"{nobody.pw_dir}/.cache/myograde-node-", done.stderr)


if __name__ == "__main__":
    unittest.main()
