#!/usr/bin/env bash
# Builds the wheels of the Python package, and tries each from nothing but its file: in a fresh virtual
# environment, with an empty PATH.
#   wheel.sh [--pure] OUT_DIR [VERSION ...]
#            (MYOGRADE_CACHE: the folder that ./dev setup filled)
# Of each CPython of these versions (default: 3.9 to 3.12) that is on the PATH or that pyenv has, and
# that has its headers, a wheel with the environments, in which auditwheel has bundled MuJoCo and the
# other libraries; and one without the environments, for every platform (--pure: only that).
# The same sources give the same pure wheel, byte for byte; SOURCE_DATE_EPOCH dates the files in it
# (default: the last commit). Exit status 77 if the tools can't be had here.
set -euo pipefail
unset PYTHONPATH  # what is on it would count as installed
pure=no
if [ "${1:-}" = --pure ]; then
  pure=yes
  shift
fi
out=${1:?usage: wheel.sh [--pure] OUT_DIR [VERSION ...]}
shift
versions=("$@")
[ $# -gt 0 ] || versions=(3.9 3.10 3.11 3.12)
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
list=$root/docker/wheel-tools.txt
tools=$cache/wheel-tools-$(sha256sum "$list" | cut -c1-12)
scratch=$(mktemp -d "${TMPDIR:-/tmp}/myograde-wheel.XXXXXX")
trap 'rm -rf "$scratch"' EXIT
export CCACHE_BASEDIR=$scratch  # another build, in another folder, finds what this one compiled

fail() { echo "error: $1" >&2; exit 4; }

"$root/docker/make_venv.sh" "$tools" "$list"
mkdir -p "$out"

epoch=$(git -C "$root" log -1 --format=%ct 2>/dev/null || true)
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-${epoch:-315532800}}

# build PYTHON FOLDER [pip options]: a wheel by that Python, into the folder. The tools are all in
# Python, so that each version can use them.
build() {
  local python=$1 folder=$2
  shift 2
  if ! PYTHONPATH=$(echo "$tools"/lib/python3*/site-packages) PATH="$tools/bin:$PATH" "$python" -m pip \
      wheel -q --no-index --no-build-isolation --no-deps --no-cache-dir --disable-pip-version-check \
      "$@" -w "$folder" "$here" >"$scratch/pip.log" 2>&1; then
    tail -n 20 "$scratch/pip.log" >&2
    fail "pip could not build the wheel; its last lines are above."
  fi
}

# keep FILE: puts a finished wheel into OUT_DIR and prints its name.
keep() {
  wheel=$out/$(basename "$1")
  install -m 644 "$1" "$wheel"
  echo "$wheel: $(sha256sum "$wheel" | cut -c1-64)"
}

# python_of VERSION: a program of that version, if there is one. A name on the PATH may be a stand-in
# that starts nothing, or a virtual environment's.
python_of() {
  local program
  for program in "/usr/bin/python$1" "python$1" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/"python$1"; do
    if "$program" -c '' 2>/dev/null; then
      echo "$program"
      return
    fi
  done
}

has_headers() {
  "$1" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))'
}

# install_fresh PYTHON VERSION: sets `environment` to one that has nothing but the wheel.
install_fresh() {
  environment=$scratch/$2-$(basename "$wheel" .whl)
  "$1" -m venv --without-pip "$environment" || fail "$1 can't make a virtual environment."
  "$tools/bin/pip" --python "$environment/bin/python" install -q --no-index --no-deps \
    --no-cache-dir --disable-pip-version-check "$wheel" ||
    fail "the wheel can't be installed for $1."
}

# try_kit PYTHON VERSION: with an empty PATH, since whoever installs it may have no compiler.
try_kit() {
  install_fresh "$1" "$2"
  (cd / && PATH='' "$environment/bin/python" -I -B -c \
    'import myograde.client, myograde.models; myograde.models.read_list(); myograde.leg_sets()') ||
    fail "the package can't be imported by $1."
  echo "CPython $2: installs and can be imported"
}

# try_environments PYTHON VERSION: gets the models and plays an episode of each track.
try_environments() {
  install_fresh "$1" "$2"
  (cd / && PATH='' MYOGRADE_CACHE=$cache "$environment/bin/python" -I -B -m myograde get-models \
    >/dev/null) || fail "the models can't be had by the wheel for $1."
  (cd / && PATH='' MYOGRADE_CACHE=$cache "$environment/bin/python" -I -B -m myograde check) ||
    fail "the wheel for $1 does not play what a grader does."
  echo "CPython $2: plays the reference episodes to the bit"
}

# build_environments PYTHON VERSION
build_environments() {
  local folder=$scratch/wheel-$2
  build "$1" "$folder" --config-settings=cmake.define.MYOGRADE_EXTENSION=ON \
    --config-settings="cmake.define.MYOGRADE_EXTENSION_BUILD=$scratch/grader"
  if ! PATH="$tools/bin:$PATH" "$tools/bin/auditwheel" repair -w "$folder/repaired" \
      "$folder"/myograde-*.whl >"$scratch/auditwheel.log" 2>&1; then
    tail -n 20 "$scratch/auditwheel.log" >&2
    fail "auditwheel could not bundle the libraries; its last lines are above."
  fi
  "$root/docker/sbom/wheel_licences.py" "$folder"/repaired/myograde-*.whl --cache "$cache" \
    --extension "$(cat "$scratch/grader/python-extension.txt")"
  keep "$folder"/repaired/myograde-*.whl
}

MYOGRADE_PURE=1 build "$tools/bin/python" "$scratch/pure"
keep "$scratch"/pure/myograde-*.whl
pure_wheel=$wheel
checked=0
for version in "${versions[@]}"; do
  python=$(python_of "$version")
  if [ -z "$python" ]; then
    echo "CPython $version: not checked, as there is no python$version here"
    continue
  fi
  wheel=$pure_wheel
  try_kit "$python" "$version"
  checked=$((checked + 1))
  [ "$pure" = no ] || continue
  if has_headers "$python"; then
    build_environments "$python" "$version"
    try_environments "$python" "$version"
  else
    echo "CPython $version: no wheel with the environments, as $python has no headers (Python.h)"
  fi
done
[ "$checked" -gt 0 ] ||
  fail "there is no CPython of these versions to check the wheel with: ${versions[*]}."
