#!/usr/bin/env python3
"""Writes the seeds of the corpora: small inputs that lead a fuzzer past the first checks.
Fuzzing's findings are beside them as found-*.  Use: seeds.py (no arguments)"""

import gzip
import hashlib
import io
import json
import pathlib
import struct
import tarfile
import zipfile

CORPUS = pathlib.Path(__file__).resolve().parent / "corpus"
MANIFEST = b'{"name": "fuzz", "command": ["./policy"]}'


def seed(target, name, content):
    folder = CORPUS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def datagrams():
    seed("datagram", "short", b"LC02\0\0\0\7MYOGRADE_ACTION\0payload")
    seed("datagram", "fragment-256-mib", b"LC03\0\0\0\1" + struct.pack(">IIHH", 1 << 28, 0, 0, 1) +
         b"A\0x")
    seed("datagram", "fragment-wraps", b"LC03\0\0\0\1" + struct.pack(">IIHH", 32, 0xfffffff0, 1, 2) +
         b"xxx")
    seed("datagram", "no-end", b"LC02\0\0\0\1" + b"c" * 64)


def leg_set(index):
    state = struct.pack(">6d", 100, 5, 0.1, 200, 6, 0.2) + struct.pack(">ibbd", 1, 0, 1, 30.0)
    return struct.pack(">b", index) + 4 * state


def messages():
    hello = struct.pack(">ii5sb", 1, 5, b"fuzz\0", 0)
    seed("decode", "hello", b"\4" + hello + struct.pack(">i", 0))
    seed("decode", "hello-legs", b"\4" + hello + struct.pack(">i", 2) + leg_set(0) + leg_set(4))
    seed("decode", "hello-no-name", b"\4" + struct.pack(">iibi", 1, 0, 0, 0))
    seed("decode", "ready", b"\5" + struct.pack(">qi", 3, 1) + leg_set(2))
    seed("decode", "ready-negative-count", b"\5" + struct.pack(">qi", 3, -1))
    action = struct.pack(">qqi3d", 0, 7, 3, 0.5, -1, 1e308)
    seed("decode", "action", bytes([6 | 3 << 3]) + action)
    seed("decode", "action-nan", bytes([6 | 3 << 3]) + struct.pack(">qqi3d", 0, 7, 3, 0, float("nan"),
                                                                    float("inf")))
    seed("decode", "action-negative-count", b"\6" + struct.pack(">qqi", 0, 7, -2147483648))
    seed("decode", "action-huge-count", b"\6" + struct.pack(">qqi", 0, 7, 2147483647))
    seed("decode", "give-up", b"\7" + struct.pack(">qq", 0, 7))
    seed("decode", "give-up-short", b"\7" + struct.pack(">q", 0))
    seed("decode", "wrong-fingerprint", b"\2" + b"\x11" * 8 + action)


def conversations():
    # 0 asks, 2 asks again, 3 is a valid message, 4 a payload on a channel, 5 raw bytes.
    hello, welcome, start = bytes([3, 0, 0]), bytes([0, 0, 0]), bytes([0, 1, 0])
    ready, step, action = bytes([3, 1, 0]), bytes([0, 2, 0, 0]), bytes([3, 2, 0, 0])
    begin = hello + welcome + start + ready
    seed("inbox", "one-step", begin + step + action)
    seed("inbox", "two-publishers", begin + step + action + action + bytes([0, 2, 0, 1]) + action +
         bytes([3, 2, 0, 1]))
    seed("inbox", "late-copies", begin + step + bytes([2]) * 3 + action * 5)
    seed("inbox", "gives-up", begin + step + bytes([3, 3, 0, 0]) * 3 + action)
    seed("inbox", "future-steps", begin + step + bytes([3, 2, 0, 9]) * 9)
    seed("inbox", "hello-flood", hello * 16)
    seed("inbox", "strays", bytes([4, 5, 1, 0]) * 14)
    seed("inbox", "forged-observation", begin + step + bytes([4, 4, 2, 0, 0]))
    fragment = b"LC03\0\0\0\1" + struct.pack(">IIHH", 1 << 28, 0xfffffff0, 0, 9) + b"A\0"
    seed("inbox", "half-sent-fragments", begin + step + (bytes([5, len(fragment)]) + fragment) * 14)


def frames():
    state = {"knee": [1, 2, 0.5], "ankle": [3, 4, -0.5], "threshold_kinds": [0, 1, 2, 0, 0],
             "thresholds": [0, 30, -1e-3, 0, 0]}
    sets = json.dumps({"0": [state] * 4, "4": [state] * 4}).encode()
    seed("frame", "hello", b"\1" + struct.pack("<IIII", 1, 1, len(sets), 0) + sets)
    seed("frame", "ready", b"\2" + struct.pack("<qII", 3, len(sets), 0) + sets)
    seed("frame", "parameters-too-long", b"\2" + struct.pack("<qII", 3, 8185, 0))
    seed("frame", "action", b"\3" + struct.pack("<qqII3d", 0, 7, 3, 0, 0.5, -1, 1e308))
    seed("frame", "action-nan", b"\3" + struct.pack("<qqIId", 0, 7, 1, 0, float("nan")))
    seed("frame", "action-too-long", b"\3" + struct.pack("<qqII", 0, 7, 81, 0))
    seed("frame", "give-up", b"\4" + struct.pack("<qq", 0, 7))
    seed("frame", "fault", b"\5" + struct.pack("<IIq", 2, 0, 256) + b"exited with status 1\0")
    seed("frame", "raw", b"\0" + struct.pack("<IIII", 0x4d794f47, 1, 5, 16))


FAULT = {"outcome": "step_timeout", "limit": "step_s", "limit_value": 1.0, "value": 1.5, "step": 3,
         "detail": "too slow"}
COMMON = {"type": "episode", "index": 4, "seed": 18446744073709551615, "steps": 3, "sim_time": 0.03,
          "clipped": 0, "digest": "ab", "wall_s": 0.5, "policy_cpu_s": 0.25}
LOCOMOTION = {"course": 2, "distance": 3.5, "start_y": 55.0, "min_y": 51.5, "final_y": 52.0,
              "effort_sum": 0.5, "pain_sum": 0.25, "solved": False, "reported_time": 300.0}
MANIPULATION = {key: 1 for key in (
    "frames", "frames_arm", "frames_prosthesis", "frames_start", "frames_goal", "frames_other",
    "solved_steps", "peak_force", "max_touch", "goal_distance_sum", "final_goal_distance",
    "final_hand_distance", "max_height", "effort_sum", "reported_time")} | {
        "goal_only_at_end": True, "placed": False, "solved": True}


ELBOW = {key: 1 for key in (
    "start_angle", "target_angle", "final_error", "smallest_error", "error_sum", "tolerance_steps",
    "longest_run", "solved_steps", "effort_sum", "reported_time")} | {"held": True, "solved": True}


def records():
    seed("record", "progress", '{"type":"progress","episode":1,"step":2}')
    seed("record", "locomotion", json.dumps(
        {**COMMON, "end": "fell", "track": "locomotion", "locomotion": LOCOMOTION}))
    seed("record", "fault", json.dumps(
        {**COMMON, "end": "fault", "fault": FAULT, "track": "manipulation",
         "manipulation": MANIPULATION}))
    seed("record", "details", json.dumps(
        {**COMMON, "end": "held", "track": "elbow", "elbow": ELBOW, "details": {
            "settle_time": None, "joint_ranges": {"r_elbow_flex": [0.1, 0.2, 0, 2.3]}}}))
    seed("record", "lease-end", json.dumps(
        {"type": "lease_end", "ok": True, "detail": "", "stdout_tail": "", "stderr_tail": "caf\u00e9",
         "stdout_truncated": False, "stderr_truncated": True, "policy_cpu_s": 1e-9,
         "simulator_cpu_s": 2.5, "wall_s": 3, "peak_memory_bytes": 9223372036854775807}))
    seed("sim_message", "fault", json.dumps({"type": "policy_fault", **FAULT}))
    seed("sim_message", "done", '{"type":"done"}')
    seed("sim_message", "no-type", "[]")
    seed("lease_order", "other-command", '{"command": ["/usr/bin/python3", "policy.py"]}')
    seed("lease_order", "gap", '{"episodes": [{"index": 0, "seed": 1, "policy_seed": 2}, '
         '{"index": 2, "seed": 1, "policy_seed": 2}]}')
    seed("lease_order", "budget", '{"track": {"budgets": {"step_s": 0}}, "uid": 62000, "slot": 3}')
    seed("record", "node", json.dumps(
        {"type": "node", "node": "n1", "job": "12", "processor": "Xeon", "cpu_s": 1e-9,
         "energy_j": 1e300, "unfit": "caf\u00e9", "lost": "x", "blamed": True}))
    seed("lease_stream", "messages", 'node 2\n{}\nlog 5\na\nb\x00c\nend 0\n\n')
    seed("lease_stream", "half", 'record 7\nabc')
    seed("lease_stream", "sizes", 'a 1\nx\nb 1000\n')
    seed("lease_stream", "order", json.dumps(
        {"order": {}, "artefact": "0" * 64, "runtimes": [{"name": "torch", "digest": ""}],
         "grader": "{}", "uid_base": -1, "prove_again": ["n1"], "comment": "1-1-c0ffee",
         "srun": ["srun"], "squeue": ["squeue"], "queue_wait_s": 60}))


def configs():
    seed("track_config", "extends", '{"extends": "manipulation", "episodes_per_lease": 3}')
    seed("track_config", "locomotion", '{"extends": "locomotion", "seeds": [1, 5, 3], "profiles": '
         '{"paper": {"budgets": {"step_s": 0.5}}}}')
    for name, value in (("zero", "0"), ("negative", "-1"), ("absurd", "1e18"), ("null", "null")):
        seed("track_config", f"limit-{name}",
             '{"extends": "manipulation", "budgets": {"memory_bytes": %s}}' % value)
    seed("track_config", "itself", '{"extends": "fuzzed"}')
    seed("track_config", "unknown-key", '{"extends": "locomotion", "gravity": 0}')
    seed("server_config", "slots", b'\0{"slots": 2, "http": {"workers": 4}}')
    seed("server_config", "zero", b'\0{"artefacts": {"files": 0}}')
    seed("server_config", "runtime", b'\0{"runtimes": {"x": {"path": "${cache}/x"}}}')
    seed("server_config", "policy", b'\2{"socket_families": ["unix", "netlink"], "kill_s": 0}')
    seed("server_config", "sim", b'\4{"open_files": 64, "silence_s": 1e300}')
    seed("server_config", "whole", b'\1{"slots": "cores"}')


def challenges():
    phase = {"name": "final", "title": "t", "track": "manipulation", "profile": "paper"}

    def cup(*phases):
        return json.dumps({"form": 1, "title": "A cup", "phases": phases})

    seed("challenge", "smallest", cup(phase))
    seed("challenge", "whole", cup({
        **phase, "seeds": {"committed": 5}, "opens_at": "2026-12-01T00:00:00Z",
        "freeze_at": "2026-12-02T00:00:00.5+01:00", "closes_at": "2026-12-03T00:00:00Z",
        "entry": "chosen", "quota": {"official_per_day": 1, "same_artefact": "everyone"},
        "show": {"metrics": False}}))
    seed("challenge", "two", cup({**phase, "seeds": {"first": 500, "count": 3}},
                                 {**phase, "name": "other", "seeds": [600, 700]}))
    seed("challenge", "overlap", cup(phase, {**phase, "name": "other"}))
    seed("challenge", "times", cup({**phase, "opens_at": "2026-12-01", "closes_at": "infinite-past"}))
    seed("challenge", "backwards", cup({**phase, "opens_at": "2026-12-02T00:00:00Z",
                                        "closes_at": "2026-12-01T00:00:00Z"}))
    seed("challenge", "no-object", "[[]]")
    seed("challenge", "numbers", cup({**phase, "seeds": {"committed": -1},
                                      "quota": {"waiting": 1e300}}))


def submissions():
    seed("manifest", "good", '{"name": "walker", "command": ["./policy", "x"], "runtimes": ["python"]}')
    for name, program in (("link", "./link"), ("up", "bin/up"), ("loop", "./loop"),
                          ("python", "./python3"), ("root", "root/etc"), ("out", "../policy")):
        seed("manifest", name, '{"name": "a", "command": ["%s"]}' % program)
    seed("manifest", "path", '{"name": "a", "command": ["python3", "policy.py"]}')
    seed("manifest", "env", json.dumps({"name": "a", "command": ["policy"], "env": {
        "OMP_NUM_THREADS": "2", "POLICY_MODE": "fast"}}))
    seed("manifest", "extra", json.dumps({"name": "a", "command": ["policy"],
                                          "extra_observations": True}))
    seed("manifest", "env-reserved", '{"name": "a", "command": ["policy"], "env": {"PATH": "/"}}')
    seed("request", "submit", b"\0" + json.dumps(
        {"artefact": "a" * 64, "team": "alpha", "track": "t", "profile": "p", "seeds": [1, 2],
         "episodes": 1}).encode())
    seed("request", "submit-hidden-mark", b"\0" + json.dumps(
        {"artefact": "a" * 64, "team": "al\u202epha", "track": "t"}, ensure_ascii=False).encode())
    for name, team in (("look-alike", "Te\u0430m \u0392lue"), ("wide", "\uff34eam\u00a0Blue"),
                       ("blank", "Team\u2800\u3164\u034f"), ("marks", "i\u0307 a\u0323\u0308\u0345")):
        seed("request", f"submit-{name}", b"\0" + json.dumps(
            {"artefact": "a" * 64, "team": team, "track": "t"}, ensure_ascii=False).encode())
    seed("request", "rerun", b'\1{"first": 0, "last": 9}')
    seed("request", "cancel", b'\2{"reason": "wrong file"}')
    seed("request", "filter", b"\3team=a&state=done&limit=5&before=9")
    seed("output", "ansi", b"\x05plain \x1b[2J words\n\xc2\x9b0m\xf0\x9f\x98\x80\0")
    seed("output", "broken", b"\0" + b"\xff\xc3\xe2\x82" * 40)


def tar(entries, mode="w"):
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=mode, format=tarfile.PAX_FORMAT) as archive:
        for name, kind, detail in entries:
            info = tarfile.TarInfo(name)
            info.type, info.mode = kind, 0o755
            if kind == tarfile.REGTYPE:
                info.size = len(detail)
                archive.addfile(info, io.BytesIO(detail))
            else:
                info.linkname = detail
                archive.addfile(info)
    return out.getvalue().rstrip(b"\0") + bytes(1024)


def archives():
    good = [("policy.json", tarfile.REGTYPE, MANIFEST), ("policy", tarfile.REGTYPE, b"#!/bin/sh\n")]
    plain = tar(good + [("d/l", tarfile.SYMTYPE, "/usr/bin/python3")])
    seed("archive", "good.tar", plain)
    seed("archive", "good.tar.gz", gzip.compress(plain, mtime=0))
    # One zstd frame of one raw block.
    seed("archive", "good.tar.zst", b"\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", len(plain)) +
         struct.pack("<I", len(plain) << 3 | 1)[:3] + plain)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, _, content in good:
            info = zipfile.ZipInfo(name)
            info.external_attr = 0o100755 << 16
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    seed("archive", "good.zip", out.getvalue())
    seed("archive", "twice.gz", gzip.compress(gzip.compress(plain, mtime=0), mtime=0))
    seed("archive", "outside.tar", tar(good + [("../evil", tarfile.REGTYPE, b"x")]))
    seed("archive", "through-link.tar", tar(good + [("d", tarfile.SYMTYPE, "/tmp"),
                                                    ("d/x", tarfile.REGTYPE, b"x")]))
    seed("archive", "unicode.tar", tar(good + [("\u00fc/" + "x" * 50, tarfile.REGTYPE, b"x")]))


def entry(kind, name, link="", content=b"", lie=0, mode=0o755):
    kinds = "0125KLxgS34670V"
    return (bytes([kinds.index(kind)]) + struct.pack(">H", mode) + bytes([len(name)]) + name.encode() +
            bytes([len(link)]) + link.encode() + bytes([len(content)]) + content + bytes([lie]))


def tars():
    seed("tar", "file", b"\3" + entry("0", "data", content=b"words"))
    seed("tar", "links", b"\3" + entry("2", "l", "/usr/bin/python3") + entry("2", "m", "../x") )
    seed("tar", "hard", b"\3" + entry("1", "h", "policy"))
    seed("tar", "device", b"\3" + entry("3", "null"))
    seed("tar", "setuid", b"\3" + entry("0", "su", mode=0o4755))
    seed("tar", "folder", b"\3" + entry("5", "d/") + entry("0", "d/x", content=b"1"))
    seed("tar", "claims-8-gib", b"\3" + entry("0", "big", content=b"1", lie=237))
    seed("tar", "pax-path", b"\3" + entry("x", "p", content=b"13 path=../x\n") + entry("0", "y"))
    seed("tar", "pax-size", b"\3" + entry("x", "p", content=b"28 size=9223372036854775807\n") +
         entry("0", "y"))
    seed("tar", "gnu-name", b"\3" + entry("L", "n", content=b"d" * 120 + b"\0") + entry("0", "y"))
    seed("tar", "sparse", b"\3" + entry("S", "s", content=b"1"))
    seed("tar", "no-manifest", b"\2" + entry("0", "policy"))


def images():
    def layer(*entries):  # (type, index of the name, index of the target) as in image_fuzz.cc
        return b"".join(kind.encode() + bytes([name, target]) for kind, name, target in entries)

    run, end = layer(("0", 24, 0)), b"8"
    seed("image", "one-layer", run + end)
    seed("image", "whiteouts", run + layer(("0", 2, 0), ("0", 4, 0)) + b"7" +
         layer(("0", 8, 0), ("0", 7, 0), ("0", 3, 0), ("0", 10, 0)) + b"7" + layer(("0", 9, 0)) +
         run + end)
    seed("image", "through-links", run + layer(("2", 5, 4), ("0", 6, 0), ("2", 0, 5), ("0", 2, 0)) +
         b"7" + layer(("0", 11, 0), ("2", 5, 2), ("0", 6, 0), ("1", 1, 8)) + end)
    seed("image", "replaced", run + layer(("3", 19, 0), ("0", 20, 0), ("5", 21, 0), ("0", 22, 0)) +
         end)
    seed("image", "preload", run + layer(("0", 18, 0)) + end)
    seed("image", "etc-is-a-link", run + layer(("2", 14, 0)) + end)
    seed("image", "user", run + layer(("0", 15, 0), ("0", 16, 0)) + end + json.dumps(
        {"Entrypoint": ["run"], "User": "app:app", "WorkingDir": "/a/b", "Env": ["PATH=/", "A=b"]}
    ).encode())
    seed("image", "folder-over-file", run + layer(("0", 0, 0)) + b"7" +
         layer(("5", 0, 0), ("0", 2, 0)) + b"7" + layer(("2", 0, 7)) + end)
    for name, config in (("numbers", {"Entrypoint": 7, "Env": {"A": 1}}),
                         ("foreign", {"architecture": "arm64", "Cmd": ["/run"]}),
                         ("no-command", {}), ("list", [[]])):
        seed("image", name, run + end + json.dumps(config).encode())


def logs():
    # Recipes: track, episode, begun, seal, then 0 a step, 1 a start, 2 a text, 3 bytes, 4 jumps.
    begin, step = b"\1\0\4\0", b"\0\0\1\2\3\4"
    seed("episode_log", "two-steps", begin + b"\0\1" + step * 2)
    seed("episode_log", "locomotion", b"\1\1\0\0\0\1" + step)
    seed("episode_log", "not-begun", b"\1\0\4\1\0")
    for seal, name in ((1, "cut-log"), (2, "too-few"), (3, "damaged"), (0xfc, "cut-off")):
        seed("episode_log", name, begin + bytes([seal]) + b"\1" + step)
    seed("episode_log", "nan", begin + b"\0\1\0\x08" + struct.pack("<d", float("nan")) + b"abcd")
    seed("episode_log", "short-action", begin + b"\0\1\0\xff" + bytes(255 % 17) + b"abcd")
    seed("episode_log", "no-start", begin + b"\0" + step)
    text = b'{"direct":true,"leg_sets":{}}'
    seed("episode_log", "start-by-hand", begin + b"\0\2\1" + bytes([len(text)]) + text + step)
    seed("episode_log", "length-lies", begin + b"\0\2\x41" + bytes([len(text)]) + text)
    seed("episode_log", "jump", begin + b"\0\1" + step + b"\4\1\1" + step)
    event = struct.pack(">IQQII", 0xEDA1DA01, 0, 0, 1, 0xffffffff) + b"X"
    seed("episode_log", "claims-4-gib", b"\0" + event)
    # A zstd frame of one raw block, and one of a block that repeats a byte 128 Ki times.
    seed("episode_log", "packed", b"\0\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", len(event)) +
         struct.pack("<I", len(event) << 3 | 1)[:3] + event)
    seed("episode_log", "packed-run", b"\0\x28\xb5\x2f\xfd\x00\x38" +
         struct.pack("<I", 0x20000 << 3 | 3)[:3] + b"x")


def receipts():
    episodes = [{"index": i, "seed": 5 + i, "outcome": "failure", "log": "a" * 64} for i in range(2)]
    receipt = {"format": 1, "episodes": episodes, "grader": {"models": {"x-1": "c"}, "mujoco": "d"},
               "track_kind": "x", "track_config": {}, "merkle_root": "e", "results": "f"}

    def canonical(value):
        return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()

    whole = {"receipt": receipt, "signature": {"algorithm": "ed25519", "value": "0" * 128}}
    seed("receipt", "signed", b"\1" + canonical(receipt))
    seed("receipt", "unsigned", b"\0" + canonical(whole) + b"\n")
    seed("receipt", "models-are-text", b"\1" + canonical({**receipt, "grader": {"models": "x-1"}}))
    seed("receipt", "seed-is-text", b"\1" + canonical({**receipt, "episodes": [
        {"index": 0, "seed": "5"}]}))
    hidden = {**receipt, "format": 2, "policy_seeds": None, "track_config": {"phase": "final"},
              "hidden": {"commitment": "b" * 64, "count": 2},
              "episodes": [{"index": i, "seed_commitment": "c" * 64} for i in range(2)]}
    seed("receipt", "hidden", b"\1" + canonical(hidden))
    seed("receipt", "hidden-without-commitment", b"\1" + canonical(
        {**hidden, "hidden": {"commitment": None, "count": 10000}}))
    seed("receipt", "hidden-with-seed", b"\1" + canonical({**hidden, "episodes": episodes}))
    seed("receipt", "no-episodes", b"\1" + canonical({**receipt, "episodes": []}))
    seed("receipt", "key", b"\0-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEA" + b"A" * 43 +
         b"=\n-----END PUBLIC KEY-----\n")


def proofs():
    """Of a record with one entry, whose leaf's hash is its root."""
    def canonical(value):
        return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()

    content = {"kind": "graded"}
    root = hashlib.sha256(b"\0" + canonical(content)).hexdigest()
    proof = {"content": content, "entry": 0, "proof": [], "root": root, "size": 1}
    seed("proof", "entry", b"\1\0\1" + canonical(proof))
    seed("proof", "entry-elsewhere", b"\1\0\1" + canonical({**proof, "entry": 1, "size": 2}))
    seed("proof", "nodes", b"\1\3\7" + canonical([root, root, root]))
    head = {"chain": root, "root": root, "size": 1}
    signed = {"head": head, "signature": {"algorithm": "ed25519", "value": "0" * 128}}
    seed("proof", "head", b"\0\0\0" + canonical(signed) + b"\n")
    seed("proof", "head-of-nothing", b"\0\0\0" + canonical(
        {**signed, "head": {**head, "chain": "", "size": 0}}) + b"\n")


def exports():
    def change(what, line, text=b""):
        return bytes([what, line, len(text)]) + text if what < 2 else bytes([what, line])

    seed("import", "unchanged", b"\1\0")
    seed("import", "wrong-checksum", b"\1\7" + change(1, 2, b'{"name":"x"}'))
    for line in range(2, 48, 2):
        seed("import", f"strange-row-{line:02}", b"\1\0" + change(1, line, json.dumps(
            {key: "strange" for key in ("state", "outcome", "reason", "facts", "metrics", "seeds",
                                        "command", "output", "grader", "config", "aggregate")}
            ).encode()[:255]) + change(1, line, b'{"id":-1,"seed":-1,"first":9,"attempt":0}'))
    seed("import", "large-number", b"\1\0" + b"".join(
        change(1, line, b'{"id":18446744073709551615}') for line in range(1, 48)))
    seed("import", "line-missing", b"\1\0" + change(2, 2))
    seed("import", "row-twice", b"\1\0" + change(3, 2))
    seed("import", "other-table", b"\1\0" + change(0, 1, b'"meta":['))
    seed("import", "deep", b"\1\0" + change(0, 2, b'{"a":' + b"[" * 240))
    empty = b'{"data":{\n},"format":"myograde-export","schema":4'
    seed("import", "no-tables", b"\0" + empty + b',"sha256":"' +
         hashlib.sha256(empty).hexdigest().encode() + b'"}\n')


def connections():
    get, end = b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\n", b"\r\n\r\n"
    post = b"POST /v1/submissions HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    seed("http", "get", get + b"\r\n")
    seed("http", "two", 2 * (get + b"\r\n"))
    seed("http", "filter", b"GET /v1/submissions?limit=5&team=%C3%A9%zz HTTP/1.1" + end)
    seed("http", "number", b"GET /v1/submissions/999999999999999999 HTTP/1.0" + end)
    seed("http", "post", post + b"Content-Length: 2" + end + b"{}")
    seed("http", "post-cut", post + b"Content-Length: 200" + end + b"{}")
    seed("http", "chunked", post + b"Transfer-Encoding: chunked" + end + b"2\r\n{}\r\n0" + end)
    seed("http", "chunk-huge", post + b"Transfer-Encoding: chunked" + end + b"ffffffffffffffff\r\n{}")
    seed("http", "two-lengths", post + b"Content-Length: 2\r\nContent-Length: 9" + end + b"{}")
    seed("http", "length-negative", post + b"Content-Length: -1" + end + b"{}")
    seed("http", "length-huge", post + b"Content-Length: 18446744073709551615" + end + b"{}")
    seed("http", "expect", post + b"Expect: 100-continue\r\nContent-Length: 2" + end + b"{}")
    seed("http", "gzip", post + b"Content-Encoding: gzip\r\nContent-Length: 20" + end +
         gzip.compress(b"", mtime=0))
    seed("http", "multipart", b"POST /v1/submissions HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; "
         b"boundary=b\r\nContent-Length: 60" + end + b"--b\r\nContent-Disposition: form-data; "
         b"name=\"a\"\r\n\r\nx\r\n--b--\r\n")
    seed("http", "form", b"POST /v1/submissions HTTP/1.1\r\nHost: localhost\r\nContent-Type: "
         b"application/x-www-form-urlencoded\r\nContent-Length: 7" + end + b"a=b&c=d")
    for name, ranges in (("range", b"1-9"), ("ranges", b"1-2,5-6"), ("range-end", b"-5"),
                         ("range-beyond", b"9-999999999"), ("range-backwards", b"9-1"),
                         ("range-overflow", b"0-99999999999999999999"),
                         ("ranges-many", b",".join([b"0-99999"] * 900))):
        seed("http", name, b"GET /v1/export HTTP/1.1\r\nHost: localhost\r\nRange: bytes=" + ranges + end)
    seed("http", "long-header", get + b"A: " + b"x" * 8000 + end)
    seed("http", "long-path", b"GET /v1/" + b"9" * 8100 + b" HTTP/1.1" + end)
    seed("http", "no-end", get + b"A: b")
    seed("http", "other-protocol", b"\x16\x03\x01\x02\x00\x01\x00")
    upload = b"POST /v1/artefacts HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/x-tar\r\n"
    seed("http", "upload", upload + b"Content-Length: 70000" + end + b"x" * 70000)
    seed("http", "upload-chunks", upload + b"Transfer-Encoding: chunked\r\nTrailer: A" + end + 2 * (
        b"9c40;a=b\r\n" + b"x" * 40000 + b"\r\n") + b"0\r\nA: b" + end + get + b"\r\n")
    seed("http", "upload-expect", upload + b"Expect: 100-continue\r\nContent-Length: 70000" + end)
    seed("http", "pipelined", post + b"Content-Length: 2" + end + b"{}" + get + b"\r\nGET /")
    seed("http", "empty-lines", 3 * b"\r\n" + get + b"\r\n")
    seed("http", "bare-lf", b"GET /v1/health HTTP/1.1\n\n")
    seed("http", "two-framings", post + b"Content-Length: 2\r\nTransfer-Encoding: chunked" + end +
         b"0" + end)
    seed("http", "body-of-get", get + b"Content-Length: 2" + end + b"{}")
    seed("http", "upgrade", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n")


def deep():
    seed("request", "deep", b"\2" + b'{"reason":' + b"[" * 4000)
    seed("manifest", "deep", b'{"name":' + b"[" * 4000 + b"]" * 4000 + b"}")


if __name__ == "__main__":
    for write in (datagrams, messages, conversations, frames, records, configs, challenges, submissions, archives,
                  tars, images, logs, proofs, receipts, exports, connections, deep):
        write()
