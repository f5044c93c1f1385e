#!/bin/sh
# Makes configs/reference anew: the golden submissions' first second of one episode of each track.
# Use: reference.sh BIN_DIR POLICIES_DIR   (MYOGRADE_CACHE as usual; the build's bin and policies)
set -eu
bin=$1
policies=$2
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$here/../../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -r "$source/configs" "$work/configs"
mkdir -p "$source/configs/reference"
for track in manipulation locomotion elbow reorientation baoding relocation chasetag; do
  case $track in
    manipulation) rules='{"max_steps": 100}' ;;
    elbow | reorientation | baoding | relocation | chasetag) rules='{"max_steps": 50}' ;;
    locomotion) rules='{"end": {"time_limit_s": 1}}' ;;
  esac
  printf '{"extends": "%s", "seeds": [20241201], "episodes_per_lease": 1, "rules": %s}' \
    "$track" "$rules" > "$work/configs/tracks/reference-$track.json"
  cp -r "$policies/kit-python" "$work/$track"
  cp "$here/player.py" "$here/$track/actions.gz" "$work/$track"
  printf '{"name": "reference", "command": ["/usr/bin/python3", "player.py"], "runtimes": ["python"]}' \
    > "$work/$track/policy.json"
  MYOGRADE_CONFIG_DIR="$work/configs" "$bin/myograde" local "$work/$track" \
    --track "reference-$track" --logs "$work/logs-$track"
  install -m 644 "$work/logs-$track"/*.lcmlog.zst "$source/configs/reference/$track.lcmlog.zst"
done
