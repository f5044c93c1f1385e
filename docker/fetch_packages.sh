#!/usr/bin/env bash
# Fills the cache folder (first argument): wheels checked by SHA-256, then
# unpacked beside each other. A second run finds everything there and
# downloads nothing. Each part appears under its final name only when whole.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${1:?usage: fetch_packages.sh CACHE}
mkdir -p "$cache/wheels"
scratch=$(mktemp -d "$cache/.unpack.XXXXXX")
trap 'rm -rf "$scratch"' EXIT

fail() { echo "error: $1" >&2; exit 4; }

# download REQUIREMENTS [pip options]: leaves the wheels in $cache/wheels.
download() {
  local requirements=$1
  shift
  if ! /usr/bin/python3 -m pip download -q --no-deps --only-binary :all: --require-hashes \
      --disable-pip-version-check -d "$cache/wheels" -r "$requirements" "$@" >"$scratch/pip.log" 2>&1; then
    tail -n 5 "$scratch/pip.log" >&2
    fail "pip could not get the packages of $(basename "$requirements") or their SHA-256 differs; pip's last lines are above. Check the network and try again."
  fi
}

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

# A runtime holds the list that it was made of: another list makes it anew.
if ! cmp -s "$here/runtime-python.txt" "$cache/runtimes/python/requirements.txt"; then
  echo "Getting the Python runtime for policies (20 MB) ..."
  download "$here/runtime-python.txt"
  mkdir -p "$scratch/python" "$cache/runtimes"
  for wheel in "$cache"/wheels/lcm-1.5.3-*.whl "$cache"/wheels/numpy-1.26.4-*.whl; do
    unzip -q -o "$wheel" -d "$scratch/python" || fail "the wheel $wheel is damaged; delete it and try again."
  done
  cp "$here/runtime-python.txt" "$scratch/python/requirements.txt"
  chmod -R a+rX "$scratch/python"
  [ ! -e "$cache/runtimes/python" ] || mv "$cache/runtimes/python" "$scratch/old-python"
  mv "$scratch/python" "$cache/runtimes/python"
fi
