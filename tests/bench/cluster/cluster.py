#!/usr/bin/python3
"""What one daemon bears as a cluster grows: runs myograde_cluster_bench at several sizes.

    cluster.py BUILD_DIR --json FILE [--plots DIR] [--quick] [--largest]
    cluster.py --from FILE --plots DIR

Every node has one lease at a time. `--largest` adds 10,000 nodes with a million leases, which takes some
minutes and two gigabytes of disk. The folder of the stores is TMPDIR's; fsync counts, so it should be
on the disk that a daemon would have. Plots are drawn as by ../plots.py."""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
CONFIGS = HERE.parents[2] / "configs"
SIZES = ((100, 10_000), (1_000, 30_000), (10_000, 100_000))
QUICK = ((20, 400), (100, 1_000))
LARGEST = (10_000, 1_000_000)
EPISODES = ((1, 20_000), (10, 20_000))  # of a lease, and leases
TEAMS = ((1, 20_000), (100, 20_000), (1_000, 20_000))
DEADLINE_S = 3600


def run(build, **options):
    words = [word for key, value in options.items()
             for word in (f"--{key.replace('_', '-')}", str(value))]
    with tempfile.TemporaryDirectory(prefix="cluster-bench-") as folder:
        done = subprocess.run([str(build / "tests/myograde_cluster_bench"), str(CONFIGS), folder,
                               *words], capture_output=True, text=True, timeout=DEADLINE_S,
                              check=False)
    if done.returncode != 0:
        raise RuntimeError(f"cluster_bench {' '.join(words)}: exit {done.returncode}: {done.stderr}")
    row = json.loads(done.stdout)
    if set(row["states"]) != {"done"}:
        raise RuntimeError(f"cluster_bench {' '.join(words)}: not all are done: {row['states']}")
    return row


def measure(build, quick, largest, say):
    def rows(settings):
        found = []
        for options in settings:
            say(f"cluster: {options}")
            found.append(run(build, **options))
        return found

    sizes = QUICK if quick else SIZES + ((LARGEST,) if largest else ())
    result = {"by_nodes": rows({"nodes": nodes, "leases": leases} for nodes, leases in sizes)}
    if not quick:
        result["by_episodes"] = rows({"nodes": 1000, "leases": leases, "lease_episodes": episodes}
                                     for episodes, leases in EPISODES)
        result["by_teams"] = rows({"nodes": 1000, "leases": leases, "teams": teams}
                                  for teams, leases in TEAMS)
    return result


def draw(result, folder):
    sys.path.insert(0, str(HERE.parent))
    import plots  # pylint: disable=import-outside-toplevel,import-error
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rows = {}
    for row in result["by_nodes"]:  # the longest run of each size
        rows[row["nodes"]] = row
    rows = [dict(row, turn_store_s=row["store_wall_s"] / row["turns"],
                 turn_mean_s=row["wall_s"] / row["turns"]) for row in rows.values()]
    with plots.plt.rc_context(plots.STYLE):
        plots.curve(folder, "cluster_turn", "A turn of the daemon's loop, by number of nodes",
                    "nodes, each with a lease of a minute", "ms per second of the cluster",
                    {"the whole turn, mean": plots.points(rows, "nodes", "turn_mean_s", 1e3),
                     "of it, the store": plots.points(rows, "nodes", "turn_store_s", 1e3)},
                    [(1000, "limit: the loop is always busy")], y_log=True)
        plots.curve(folder, "cluster_rate", "Leases that one daemon can play",
                    "nodes", "leases per second",
                    {"when it does nothing else": plots.points(rows, "nodes", "leases_per_s", 1)})
        plots.curve(folder, "cluster_memory", "Memory of the daemon's engine and store", "nodes",
                    "resident memory, MB",
                    {"peak": plots.points(rows, "nodes", "peak_bytes", 1e-6),
                     "all submissions queued": plots.points(rows, "nodes", "filled_bytes", 1e-6)})
        views = [dict(row["views_s"], nodes=row["nodes"]) for row in rows if row["views_s"]]
        plots.curve(folder, "cluster_views", "What people ask of the engine, by number of nodes",
                    "nodes", "time of a call, ms",
                    {name: plots.points(views, "nodes", key, 1e3) for name, key in
                     (("leases that run", "running"), ("health", "health"),
                      ("the queue", "queue_of"), ("one place", "outlook_of"))}, y_log=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("build", type=pathlib.Path, nargs="?", metavar="BUILD_DIR")
    parser.add_argument("--from", dest="earlier", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--plots", type=pathlib.Path, metavar="DIR")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--largest", action="store_true")
    options = parser.parse_args()
    if (options.build is None) == (options.earlier is None):
        parser.error("either BUILD_DIR or --from is needed")
    if options.earlier is not None:
        result = json.loads(options.earlier.read_text())
    else:
        result = measure(options.build, options.quick, options.largest,
                         lambda text: print(text, file=sys.stderr, flush=True))
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if options.plots is not None:
        draw(result, options.plots)


if __name__ == "__main__":
    main()
