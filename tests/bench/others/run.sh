#!/usr/bin/env bash
# Measures other people's environments beside ours, on this machine in one run.
#
# usage: run.sh BUILD_DIR [--json FILE] [--quick]      (BUILD_DIR as for bench.py)
# What can't be installed here is skipped, and the table says why.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=${1:?usage: run.sh BUILD_DIR [--json FILE] [--quick]}
shift
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
pinned=$here/../../differential/requirements.txt

# venv NAME REQUIREMENTS...: its Python, or "" with the reason in `why`.
venv() {
  python=$cache/$1/bin/python why=
  if ! why=$("$here/../../../docker/make_venv.sh" "$cache/$1" "${@:2}" 2>&1); then
    python=
  fi
}

options=()
case " $* " in
  *" --help "* | *" -h "*) ;;
  *)
    echo "Packages of the others (600 MB where they are not in the cache yet) ..." >&2
    venv official-2.8.4 "$pinned"
    options+=("--myosuite=$python" "--myosuite-why=$why")
    venv official-2.8.4-grpc "$pinned" "$here/grpc.txt"
    options+=("--loop=$python" "--loop-why=$why")
    venv envpool-1.2.5 "$here/envpool.txt"
    options+=("--envpool=$python" "--envpool-why=$why")
    gym=$here/../../../docker/gym.txt
    venv "gym-$(sha256sum "$gym" | cut -c1-12)" "$gym"
    options+=("--vector=$python" "--vector-why=$why")
    export PYTHONPATH=$(cd "$build" && pwd)/python
    ;;
esac
exec /usr/bin/python3 -B "$here/others.py" --build "$build" --source "$here/../../.." \
  "${options[@]}" "$@"
