"""The layouts and leg sets of the Python package are the grader's. With --write it makes the
package's tracks.json anew from what the program myograde prints."""

import json
import math
import os
import pathlib
import re
import subprocess
import sys
import unittest

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
FILE = SOURCE / "policies/python/myograde/policy/tracks.json"


def spec(*words):
    said = subprocess.run([BIN / "myograde", "spec", *words, "--json"], capture_output=True,
                          text=True, check=True, timeout=60)
    return json.loads(said.stdout)


def leg_sets(rules):
    """The sets in force: without any of its own, a profile has the controller's default four times
    or however many it stores."""
    leg = rules["leg"]
    paper = spec("--track", "locomotion")["profiles"]["paper"]["rules"]["leg"]
    return leg["parameter_sets"] or [paper["parameter_sets"][0]] * leg["sets"]


def expected():
    kinds = {folder.name for folder in (SOURCE / "protocol/tracks").iterdir() if folder.is_dir()}
    tracks = {}
    for kind in sorted(kinds):  # each has a track of its own name
        told = spec("--track", kind)
        assert told["kind"] == kind, told["kind"]
        tracks[kind] = {"control_period_s": told["control_period_s"],
                        "observation": told["observation"]["parts"],
                        "extra": told["extra_observation"]["parts"],
                        "action": told["action"]["parts"]}
        if any("leg" in profile["rules"] for profile in told["profiles"].values()):
            tracks[kind]["leg_sets"] = {name: leg_sets(profile["rules"])
                                        for name, profile in sorted(told["profiles"].items())}
    return tracks


class Layouts(unittest.TestCase):
    def test_the_packages_tracks_are_the_graders(self):
        self.assertEqual(json.loads(FILE.read_text()), expected(),
                         "write it anew with: layouts_test.py --write")

    def test_the_body_weight_is_the_simulators(self):
        import myograde.policy
        text = (SOURCE / "sim/locomotion/leg.cc").read_text()
        mass = float(re.search(r"kBodyMass = ([\d.]+);", text)[1])
        self.assertEqual(myograde.policy.BODY_WEIGHT_N, mass * 9.81)

    def test_the_default_set_is_the_simulators(self):
        """The profiles without sets of their own use the one of the simulator's code."""
        import myograde
        text = (SOURCE / "sim/locomotion/leg.cc").read_text()
        code = text[text.index("MakeDefaultSet() {"):text.index("return MakeLegSet(set)")]
        rows = [list(map(float, numbers)) for numbers in re.findall(
            r"\{([\d.]+), ([\d.]+), (-?\d+)\}, \{([\d.]+), ([\d.]+), (-?\d+)\}", code)]
        self.assertEqual(len(rows), 4)
        for profile, count in (("myosuite", 4), ("as-graded", 4), ("paper", 5)):
            sets = myograde.leg_sets(profile)
            self.assertEqual(len(sets), count)
            states = [getattr(sets[0], name) for name in myograde.policy.leg.STATES]
            told = [[joint.stiffness, joint.damping, round(math.degrees(joint.target), 9)]
                    for state in states for joint in (state.knee, state.ankle)]
            self.assertEqual([a + b for a, b in zip(told[::2], told[1::2])], rows)
        untils = re.findall(r"states\[(\d)\]\.until\[k(\w+)\] = \{ThresholdKind::k(\w+), "
                            r"([\d.]+)\}", code)
        found = {(str(number), until.quantity.title().replace("_", ""),
                  "Above" if until.above else "Below")
                 for number, state in enumerate(states) for until in state.until}
        self.assertEqual(found, {until[:3] for until in untils})


def write():
    rows = []
    for kind, track in expected().items():
        parts = [f'  "{key}": [\n    ' + ",\n    ".join(map(json.dumps, value)) + "\n  ]"
                 if isinstance(value, list) and value else f'  "{key}": {json.dumps(value)}'
                 for key, value in track.items()]
        rows.append(f'"{kind}": {{\n' + ",\n".join(parts) + "\n}")
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        write()
    else:
        unittest.main(verbosity=2)
