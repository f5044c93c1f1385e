#!/usr/bin/env bash
# Builds the wheel of the Python package and installs it, from nothing but its file, in a fresh
# virtual environment of each CPython of these versions (default: 3.9 to 3.12) that is on the PATH
# or that pyenv has.
#   wheel.sh OUT_DIR [VERSION ...]      (MYOGRADE_CACHE: folder in which the build's tools are kept)
# The same sources give the same bytes; SOURCE_DATE_EPOCH dates the files in the wheel (default: the
# last commit). Exit status 77 if the tools can't be had here.
set -euo pipefail
out=${1:?usage: wheel.sh OUT_DIR [VERSION ...]}
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

fail() { echo "error: $1" >&2; exit 4; }

"$root/docker/make_venv.sh" "$tools" "$list"

epoch=$(git -C "$root" log -1 --format=%ct 2>/dev/null || true)
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-${epoch:-315532800}}
if ! "$tools/bin/pip" wheel -q --no-index --no-build-isolation --no-deps --no-cache-dir \
    --disable-pip-version-check -w "$scratch/wheel" "$here" >"$scratch/pip.log" 2>&1; then
  tail -n 20 "$scratch/pip.log" >&2
  fail "pip could not build the wheel; its last lines are above."
fi
mkdir -p "$out"
wheel=$out/$(cd "$scratch/wheel" && echo myograde-*.whl)
install -m 644 "$scratch"/wheel/myograde-*.whl "$wheel"
echo "$wheel: $(sha256sum "$wheel" | cut -c1-64)"

# python_of VERSION: a program of that version, if there is one. A name on the PATH may be a stand-in
# that starts nothing.
python_of() {
  local program
  for program in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/"python$1"; do
    if "$program" -c '' 2>/dev/null; then
      echo "$program"
      return
    fi
  done
}

# check PYTHON VERSION: with an empty PATH, since whoever installs it may have no compiler.
check() {
  local environment=$scratch/$2
  "$1" -m venv --without-pip "$environment" || fail "$1 can't make a virtual environment."
  "$tools/bin/pip" --python "$environment/bin/python" install -q --no-index --no-deps \
    --no-cache-dir --disable-pip-version-check "$wheel" ||
    fail "the wheel can't be installed for $1."
  (cd / && PATH='' "$environment/bin/python" -I -B -c \
    'import myograde.client, myograde.models; myograde.models.read_list(); myograde.leg_sets()') ||
    fail "the package can't be imported by $1."
  echo "CPython $2: installs and can be imported"
}

checked=0
for version in "${versions[@]}"; do
  python=$(python_of "$version")
  if [ -n "$python" ]; then
    check "$python" "$version"
    checked=$((checked + 1))
  else
    echo "CPython $version: not checked, as there is no python$version here"
  fi
done
[ "$checked" -gt 0 ] ||
  fail "there is no CPython of these versions to check the wheel with: ${versions[*]}."
