#!/usr/bin/python3 -ISB
"""Stands in for myograde-runner: plays a lease without physics.

The second word of the policy's command says how: "ok", "slow" (0.2 s per
episode), "crash" (every episode fails by the participant's fault), "grader" (always
the grader's fault), "once" (the grader's fault on the first attempt, after
one episode), "garbage", "dies", "unrepeatable", "stubborn" (10 s per episode, and
exits only when killed), "mute" (prints nothing until it is killed), "logged" (each episode
names a log, which nobody writes) and "old" (no details, as runners of earlier versions). "skill-P-Q-F-E"
places the object in the episodes up to P, or up to Q if "max_time_s" of the rules is not 10, with a peak
force of F and an effort of E. "says-HEX" crashes with this text, in hexadecimal, as its output and as the
reason. The daemon's self-test ("-c") passes; with a file "broken" beside this program nothing does.
"""

import hashlib
import json
import os
import signal
import sys
import time


def say(record):
    print(json.dumps(record), flush=True)


def manipulation(success, force=10.0, effort=1.5):
    facts = {name: 0 for name in (
        "frames", "frames_start", "frames_goal", "frames_other", "solved_steps")}
    facts.update({name: 0.0 for name in (
        "max_touch", "goal_distance_sum", "final_goal_distance", "final_hand_distance",
        "max_height", "reported_time")})
    facts.update(frames_arm=100, frames_prosthesis=100, goal_only_at_end=success, placed=success,
                 solved=success, peak_force=force, effort_sum=effort)
    return facts


FINGERS = [f"{joint}{finger}_{motion}" for finger in range(2, 6) for joint, motion in (
    ("mcp", "flexion"), ("mcp", "abduction"), ("pm", "flexion"), ("md", "flexion"))]
JOINTS = ["elv_angle", "shoulder_elv", "shoulder_rot", "elbow_flexion", "pro_sup", "deviation",
          "flexion", "cmc_abduction", "cmc_flexion", "mp_flexion", "ip_flexion", *FINGERS]


def details(seed, success):
    """As far as the episode goes: an object that is not handed over is never released."""
    times = {"first_contact_time": 0.25 + seed % 10 / 100, "peak_force_time": 0.5,
             "handover_time": 1.5, "release_time": 1.75, "goal_contact_time": 2.0}
    if not success:
        times.update(handover_time=None, release_time=None, goal_contact_time=None)
    return {**times, "joint_ranges": {
        joint: [-0.1 * place, 0.1 * place, -0.2 * place - 0.1, 0.2 * place + 0.1]
        for place, joint in enumerate(JOINTS)}}


def skill(mode, index, rules):
    """Whether the episode is a success, its peak force and its effort."""
    usual, other, force, effort = (int(word) for word in mode.split("-")[1:])
    return index < (usual if rules["max_time_s"] == 10 else other), float(force), float(effort)


def episode(order, mode, rules):
    index, seed = order["index"], order["seed"]
    digest = hashlib.sha256(f"{seed}/{order['policy_seed']}".encode())
    if mode == "unrepeatable":
        digest.update(os.urandom(8))
    success, force, effort = seed % 2 == 0, 10.0, 1.5
    if mode.startswith("skill-"):
        success, force, effort = skill(mode, index, rules)
    record = {
        "type": "episode", "index": index, "seed": seed, "end": "placed" if success else "time",
        "steps": 100 + seed % 1000, "sim_time": 1.0 + seed % 1000 / 100, "clipped": 0,
        "digest": digest.hexdigest(), "wall_s": time.monotonic() % 1, "policy_cpu_s": 0.01,
        "track": "manipulation", "manipulation": manipulation(success, force, effort)}
    if mode not in ("crash", "-c", "old"):
        record["details"] = details(seed, success)
    if mode == "logged":
        record["log"] = {"sha256": hashlib.sha256(f"log of {seed}".encode()).hexdigest(),
                         "bytes": 10, "packed_bytes": 10, "steps": record["steps"]}
    if mode in ("crash", "-c") or mode.startswith("says-"):
        record.update(end="fault", fault={
            "outcome": "crash", "limit": "", "limit_value": 0.0,
            "value": 7.0 * 256 if mode == "-c" else 139.0, "step": 7,
            "detail": said(mode) or "the policy died of signal 11"})
    return record


def said(mode):
    return bytes.fromhex(mode.removeprefix("says-")).decode() if mode.startswith("says-") else ""


def main():
    with open(sys.argv[-1], encoding="utf-8") as file:
        order = json.load(file)
    mode = order["command"][1]
    attempt = int(order["lease"].split("-")[1])
    detail = ""
    broken = os.path.join(os.path.dirname(__file__), "broken")
    if os.path.exists(broken):
        with open(broken, encoding="utf-8") as file:
            detail = file.read()
        order["episodes"] = []
    if mode == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if mode == "mute":
        time.sleep(600)
    if mode == "dies":
        sys.exit("out of luck")
    if mode == "garbage":
        print("{not a record", flush=True)
        time.sleep(60)
    for place, entry in enumerate(order["episodes"]):
        if mode == "grader" or (mode == "once" and attempt == 1 and place == 1):
            detail = "the simulator vanished"
            break
        say({"type": "progress", "episode": entry["index"], "step": 1})
        if mode in ("slow", "unrepeatable"):
            time.sleep(0.2)
        if mode == "stubborn":
            time.sleep(10)
        say(episode(entry, mode, order["track"]["rules"]))
    say({"type": "lease_end", "ok": not detail, "detail": detail, "stdout_tail": said(mode),
         "stderr_tail": said(mode) or "hello from the policy", "stdout_truncated": False,
         "stderr_truncated": False, "policy_cpu_s": 0.1, "simulator_cpu_s": 0.1,
         "wall_s": 0.2, "peak_memory_bytes": 0})


main()
