#!/usr/bin/env bash
# Fills the cache folder (first argument): wheels checked by SHA-256, then
# unpacked beside each other. A second run finds everything there and
# downloads nothing. Each part appears under its final name only when whole.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${1:?usage: fetch_packages.sh CACHE}
mkdir -p "$cache"

# As participants get them on their machines.
/usr/bin/python3 -B "$here/../policies/python/myograde/models.py" "$cache" "$here/wheels.txt"

# nanobind, as headers and sources.
if [ ! -e "$cache/nanobind-2.9.2" ]; then
  echo "Getting nanobind ..."
  download "$here/nanobind.txt"
  unzip -q -o "$cache"/wheels/nanobind-2.9.2-*.whl -d "$scratch/nanobind" ||
    fail "the wheel of nanobind in $cache/wheels is damaged; delete it and try again."
  chmod -R a+rX "$scratch/nanobind"
  mv "$scratch/nanobind" "$cache/nanobind-2.9.2"
fi

# As organisers make runtimes. Another list makes it anew.
for runtime in python template-2024; do
  /usr/bin/python3 -B "$here/../server/runtime/make/make_runtime.py" add "$cache/runtimes" "$runtime" \
    "$here/../policies/runtimes/$runtime" --if-changed
done
