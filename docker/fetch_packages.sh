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

# three.js: the modules that the web pages use, each with the digest that it has in npm's package (of
# GLTFLoader.js, which this wheel changed one import of, the wheel's own).
three=(bdbe1d0133b5e8e02bd6299abc75338ab32e5225c0db39f4f3e76a22cbbeb156:three.module.js
       80efaadea4f8a636a65fb0bd08bfef62f3d93a0bb94e2e7500f23176c5c07f4e:modules/OrbitControls.js
       23b6b99713461cdba78099b4cacf82f780cc03b9b1fe1afdc87c0f0f6fd31f2b:modules/GLTFLoader.js
       c25b7930e570e9ec56173cd3b866ec8d2e10016630db3937efb439daf1cedbf6:modules/BufferGeometryUtils.js)
if [ ! -e "$cache/three-0.168.0" ]; then
  echo "Getting three.js ..."
  download "$here/three.txt"
  mkdir "$scratch/three"
  for file in "${three[@]}"; do
    unzip -q -o -j "$cache"/wheels/nicegui-2.24.2-*.whl "nicegui/elements/lib/three/${file#*:}" -d "$scratch/three" &&
      echo "${file%%:*}  $scratch/three/${file##*[:/]}" | sha256sum --check --status ||
      fail "the wheel of nicegui in $cache/wheels is damaged; delete it and try again."
  done
  chmod -R a+rX "$scratch/three"
  mv "$scratch/three" "$cache/three-0.168.0"
fi

# As organisers make runtimes. Another list makes it anew.
for runtime in python template-2024; do
  /usr/bin/python3 -B "$here/../server/runtime/make/make_runtime.py" add "$cache/runtimes" "$runtime" \
    "$here/../policies/runtimes/$runtime" --if-changed
done
