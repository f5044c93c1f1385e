"""`myograde doctor --cluster` with Slurm commands that answer as told: each missing thing is found.
usage: cluster_doctor_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import CliCase, SOURCE_DIR, myograde, validate  # pylint: disable=wrong-import-position

SHEBANG = "#!/bin/sh\n"
SINFO = "echo 'debug*|up|infinite|2|idle'; echo 'debug*|up|infinite|1|down*'; echo 'big|up|1:00|1|mix'"
CONFIG = "echo 'MaxJobCount             = 10000'"
# A node that is this host: it runs the script that srun is given.
NODE = 'while [ "$1" != /bin/sh ]; do shift; done; exec "$@"'
SRUN = f'case "$*" in --version) echo "slurm 22.05.8";; *--test-only*) ;; *) {NODE};; esac'
COMMANDS = {"squeue": "true", "scancel": "true", "sinfo": SINFO, "srun": SRUN,
            "scontrol": 'case "$1" in ping) echo "Slurmctld(primary) at head is UP";; '
                        f"*) {CONFIG};; esac"}
ALL = ["configs", "executor", "slurm_commands", "slurm_controller", "slurm_partition",
       "slurm_limits", "slurm_job", "cluster_node", "cluster_clock", "daemon"]


class ClusterDoctorTest(CliCase):
    def setUp(self):
        super().setUp()
        for name in ("slurm", "bin", "cache", "data"):
            os.mkdir(self.path(name))
        for name, body in COMMANDS.items():
            self.command(name, body)
        self.path("bin/myograde-node", SHEBANG, 0o755)
        self.path("cache/model", "x")

    def command(self, name, body):
        self.path(f"slurm/{name}", f"{SHEBANG}echo \"$0 $*\" >> {self.temp}/asked\n{body}\n", 0o755)

    def asked(self):
        with open(self.path("asked"), encoding="utf-8") as file:
            return file.read()

    def doctor(self, *args, executor="slurm", **slurm):
        with open(f"{SOURCE_DIR}/configs/server.json", encoding="utf-8") as file:
            config = json.load(file)
        config["executor"] = executor
        config["slurm"].update({"slurm_bin_dir": self.path("slurm"), "bin_dir": self.path("bin"),
                                "cache_dir": self.path("cache"), **slurm})
        folder = self.path("configs")
        os.makedirs(folder, exist_ok=True)
        for part in ("tracks", "reference"):
            if not os.path.exists(f"{folder}/{part}"):
                os.symlink(f"{SOURCE_DIR}/configs/{part}", f"{folder}/{part}")
        self.path("configs/server.json", json.dumps(config))
        return myograde("doctor", "--cluster", *args, "--data", self.path("data"),
                        MYOGRADE_CONFIG_DIR=folder)

    def checks(self, status, **slurm):
        done = self.doctor("--json", **slurm)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        value = json.loads(done.stdout)
        validate(value, "doctor")
        for check in value["checks"]:
            poor = check["state"] != "ok"
            self.assertTrue(check["found"], check)
            self.assertEqual((bool(check["costs"]), bool(check["todo"])), (poor, poor), check)
        return {check["name"]: check for check in value["checks"]}

    def missing(self, name, words, **slurm):
        check = self.checks(4, **slurm)[name]
        self.assertEqual(check["state"], "missing")
        self.assertIn(words, check["found"])

    def degraded(self, name, words, **slurm):
        check = self.checks(0, **slurm)[name]
        self.assertEqual(check["state"], "degraded")
        self.assertIn(words, check["found"])

    def test_a_cluster_that_has_everything(self):
        checks = self.checks(0)
        self.assertEqual(list(checks), ALL)
        self.assertEqual({check["state"] for check in checks.values()}, {"ok"})
        self.assertIn("2 of 3 nodes", checks["slurm_partition"]["found"])

    def test_the_job_is_asked_for_as_the_config_says(self):
        self.checks(0, partition="big", account="lab", qos="high", constraint="avx2",
                    reservation="cup", memory_mib=2000, cpus=3, time_limit_min=7,
                    extra_options=["--nice=5"])
        for words in ("-p big", "--partition=big", "--account=lab", "--qos=high",
                      "--constraint=avx2", "--reservation=cup", "--mem=2000M", "--cpus-per-task=3",
                      "--time=7", "--nice=5", "--test-only"):
            self.assertIn(words, self.asked())

    def test_text_for_people(self):
        done = self.doctor()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("The cluster has everything that MyoGrade needs.", done.stdout)
        self.command("scontrol", "echo \"no \x1b[2J\"; exit 1")
        done = self.doctor()
        self.assertEqual(done.returncode, 4)
        self.assertNotIn("\x1b", done.stdout)
        self.assertIn("The cluster can't grade yet", done.stdout)

    def test_leases_that_run_on_the_host(self):
        self.degraded("executor", "is local", executor="local")

    def test_each_command_that_is_not_there(self):
        for name in COMMANDS:
            os.remove(self.path(f"slurm/{name}"))
            self.missing("slurm_commands", f"there is no {name}")
            self.command(name, COMMANDS[name])

    def test_commands_without_a_configuration(self):
        self.command("srun", "echo 'fatal: Could not establish a configuration source' >&2; exit 1")
        self.missing("slurm_commands", "Could not establish a configuration source")

    def test_no_controller(self):
        self.command("scontrol", "echo 'Slurmctld(primary) at head is DOWN'")
        self.missing("slurm_controller", "is DOWN")
        self.command("scontrol", "echo 'Unable to contact slurm controller' >&2; exit 1")
        self.missing("slurm_controller", "Unable to contact slurm controller")

    def test_partitions(self):
        self.command("sinfo", "true")
        self.missing("slurm_partition", 'no partition "none"', partition="none")
        self.missing("slurm_partition", "no default partition")
        self.command("sinfo", "echo 'debug*|up|infinite|3|down*'")
        self.missing("slurm_partition", "0 of 3 nodes")
        self.command("sinfo", "echo 'debug*|drain|infinite|3|idle'")
        self.missing("slurm_partition", "is drain")
        self.command("sinfo", "echo 'sinfo: error: no' >&2; exit 1")
        self.missing("slurm_partition", "sinfo exited with status 1")

    def test_limits(self):
        small = "echo 'MaxJobCount = 50'"
        self.command("scontrol", COMMANDS["scontrol"].replace(CONFIG, small))
        self.degraded("slurm_limits", "MaxJobCount is 50", most_jobs=51)
        self.command("scontrol", COMMANDS["scontrol"].replace(CONFIG, "true"))
        self.degraded("slurm_limits", "can't be read")

    def test_an_account_that_may_not(self):
        self.command("srun", 'case "$*" in --version) echo "slurm 22";; *) echo "allocation '
                     'failure: Invalid account or account/partition combination" >&2; exit 1;; esac')
        self.missing("slurm_job", "Invalid account")

    def test_what_a_node_lacks(self):
        os.remove(self.path("bin/myograde-node"))
        self.missing("cluster_node", "myograde-node")
        self.path("bin/myograde-node", SHEBANG, 0o755)
        os.remove(self.path("cache/model"))
        self.missing("cluster_node", "the models in ")
        self.path("cache/model", "x")

    def test_a_clock_that_is_wrong(self):
        self.command("srun", SRUN.replace('exec "$@"', '"$@" | sed "s/^time=.*/time=1000/"'))
        self.degraded("cluster_clock", "the clock of ")

    def test_no_node_is_free(self):
        busy = "echo 'srun: error: Unable to allocate resources: Requested nodes are busy' >&2; exit 1"
        self.command("srun", SRUN.replace(NODE, busy))
        self.degraded("cluster_node", "Requested nodes are busy")

    def test_configs_that_can_not_be_read(self):
        done = self.doctor("--json", queue_wait_s=-1)
        self.assertEqual(done.returncode, 4)
        self.assertEqual([check["name"] for check in json.loads(done.stdout)["checks"]],
                         ["configs", "daemon"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
