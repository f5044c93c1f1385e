"""Compares the daemon's report of a run with what the table expects. Every function returns
mistakes as sentences; none means that all is well."""

import json
import math
import os

from host import SEEDS
from table import SCORED

TAIL_BYTES = 4096
FAULT_SLACK_S = 2.0  # between a broken limit and the death of what broke it


def findings(outputs):
    """What the program reported: name -> list of results, in order."""
    found = {}
    for output in outputs:
        for line in output["stderr_tail"].split("\n"):
            words = line.split(" ", 2)
            if len(words) == 3 and words[0] == "RT":
                found.setdefault(words[1], []).append(words[2])
    return found


def relaxed(variant, missing):
    """Whether the host lacks something that the variant's verdict needs."""
    return any(check in missing for check in variant.lacking)


def outcomes(variant, missing):
    """Allowed outcomes on a host that lacks the doctor's checks `missing`."""
    for check, expected in variant.lacking.items():
        if check in missing:
            return expected
    return variant.expect


def _outcome(variant, rows, missing):
    expected = outcomes(variant, missing)
    if len(rows) != variant.episodes:
        yield f"{len(rows)} of {variant.episodes} episodes were recorded"
    for row in rows:
        if row["outcome"] not in expected:
            words = row["fault"]["detail"] if row["fault"] else row["reason"]
            yield f"{row['outcome']} ({words}), expected {' or '.join(expected)}"


def _evidence(variant, rows, missing):
    """A participant's fault states which limit, its value, the step, and a sentence."""
    as_planned = not relaxed(variant, missing)
    for row in rows:
        fault = row["fault"]
        if row["outcome"] in SCORED:
            if fault is not None:
                yield f"a {row['outcome']} has a fault: {fault['detail']}"
            continue
        if fault is None or not fault["detail"]:
            yield f"{row['outcome']} without evidence"
            continue
        if fault["outcome"] != row["outcome"]:
            yield f"the evidence is about {fault['outcome']}"
        if row["outcome"].endswith(("_limit", "_timeout")) and not fault["limit"]:
            yield f"{row['outcome']} names no limit"
        if not as_planned:
            continue
        if variant.limit and fault["limit"] != variant.limit:
            yield f"the limit is \"{fault['limit']}\", expected \"{variant.limit}\""
        if variant.detail not in fault["detail"]:
            yield f"\"{fault['detail']}\" does not say \"{variant.detail}\""
        if variant.steps is not None and (row["steps"], fault["step"]) != (variant.steps,) * 2:
            yield f"{row['steps']} steps and a fault at {fault['step']}, expected {variant.steps}"
        if variant.wall_s is not None and row["wall_s"] > variant.wall_s + FAULT_SLACK_S:
            yield f"it took {row['wall_s']:.1f} s to end it, expected {variant.wall_s}"


def _findings(variant, found, missing):
    if relaxed(variant, missing):
        return
    for name in variant.denied:
        if name not in found:
            yield f"{name} was never tried"
        for result in found.get(name, []):
            if result not in variant.denied_with:
                yield f"{name}: {result}"
    for name, expected in variant.reports.items():
        results = set(found.get(name, ["nothing"]))
        if results != {expected}:
            yield f"{name} is {', '.join(sorted(results))}, expected {expected}"
    for name, most in variant.at_most.items():
        for result in found.get(name, ["nothing"]):
            if not result.isdigit() or int(result) > most:
                yield f"{name} is {result}, expected at most {most}"


def _output(variant, result):
    for output in result["output"]:
        for stream in ("stdout", "stderr"):
            tail = output[f"{stream}_tail"]
            if len(tail.encode()) > TAIL_BYTES:
                yield f"{len(tail.encode())} bytes of {stream} were kept"
            if any((ord(c) < 32 and c not in "\n\t") or 127 <= ord(c) < 160 for c in tail):
                yield f"control characters in {stream}"
            for words in variant.absent:
                if words in tail:
                    yield f"{words!r} in {stream}"
            if stream in variant.truncated and not output[f"{stream}_truncated"]:
                yield f"{stream} is not marked as truncated"
    cpu = sum(output["policy_cpu_s"] for output in result["output"])
    if cpu < variant.cpu_s:
        yield f"{cpu:.2f} s of CPU time were counted, expected {variant.cpu_s} at least"


def _grader(status, result):
    """Nothing was the grader's fault, and nothing was retried."""
    for block in status["blocks"]:
        if block["faults"] or block["attempt"] != 1:
            yield f"the grader's fault: {block['detail']}"
    if status["state"] not in ("done", "failed"):
        yield f"it ended as {status['state']}: {status['reason']}"
    if result["not_repeatable"]:
        yield "an episode was played twice and came out otherwise"
    faults = all(row["outcome"] not in SCORED + ("unstable",) for row in result["episode_rows"])
    if (status["state"] == "failed") != faults and status["state"] in ("done", "failed"):
        yield f"state {status['state']} does not fit its episodes"


def _finite(value, path=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _finite(inner, f"{path}.{key}")
    elif isinstance(value, list):
        for inner in value:
            yield from _finite(inner, path)
    elif isinstance(value, float) and not math.isfinite(value):
        yield f"{path[1:]} is {value}"


def _clean_text(host, result):
    for words in (("show", result["submission"], "--episodes"), ("status", result["submission"])):
        text = host.verb(*words).stdout
        if any(byte < 32 and byte not in (9, 10) for byte in text) or b"\xc2\x9b" in text:
            yield f"control characters in the output of {words[0]}"


def _same_hash(found):
    if len({*found.get("hash0", ["a"]), *found.get("hash1", ["b"])}) != 1:
        yield f"the program differs between episodes: {found.get('hash0')}, {found.get('hash1')}"


def _own_network(host, found):
    """Of its network it reads about its own sockets only, unless an ordinary user runs the daemon."""
    shown = set(",".join(found.get("network", ["nothing"])).split(","))
    strange = shown - {"dev", "if_inet6", "igmp", "ipv6_route", "route", "tcp", "tcp6", "udp",
                       "udp6", "unix"}
    if strange and host.user is None and os.geteuid() == 0:
        yield f"it can read {', '.join(sorted(strange))} of its network"


def _no_seed(result, found):
    told = json.dumps(result["output"])
    for row in result["episode_rows"]:
        if row["seed"] not in SEEDS:
            yield f"seed {row['seed']} is not the track's"
    seeds = {str(seed) for seed in SEEDS}
    if any(seed in told for seed in seeds):
        yield "a seed of the track is known to the program"
    told_seeds = found.get("policy_seed0", []) + found.get("policy_seed1", [])
    if len(told_seeds) != 2 or len(set(told_seeds)) != 2:
        yield f"policy seeds are {told_seeds}"


def _further(variant, result, found, host):
    if variant.check == "finite":
        yield from _finite(result)
        if "huge" in variant.args[0] and variant.profile is None:
            if not all(row["clipped"] > 0 for row in result["episode_rows"]):
                yield "no clipped entry was counted"
    elif variant.check == "clean_text":
        yield from _clean_text(host, result)
    elif variant.check == "canary":
        if (host.root / "canary").read_text() != host.CANARY:
            yield "a file of the host was changed"
    elif variant.check == "same_hash":
        yield from _same_hash(found)
    elif variant.check == "own_network":
        yield from _own_network(host, found)
    elif variant.check == "no_seed":
        yield from _no_seed(result, found)
    elif variant.check is not None:
        yield f"unknown check {variant.check}"


def mistakes(variant, status, result, host, missing):
    """Everything that is wrong with one run of a variant."""
    rows = result["episode_rows"]
    found = findings(result["output"])
    return [*_grader(status, result), *_outcome(variant, rows, missing),
            *_evidence(variant, rows, missing), *_findings(variant, found, missing),
            *_output(variant, result), *_further(variant, result, found, host)]


def identity(result):
    """An honest result, down to the last bit, without what depends on the host's clock."""
    rows = [{key: value for key, value in row.items()
             if key not in ("wall_s", "policy_cpu_s", "attempt")}
            for row in result["episode_rows"]]
    return json.dumps({"rows": rows, "aggregate": result["aggregate"], "hashes": result["hashes"]},
                      sort_keys=True)
