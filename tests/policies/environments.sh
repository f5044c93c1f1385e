#!/usr/bin/env bash
# Runs a Python test with pinned Gymnasium, the grader's maths functions, and what the sanitized
# extension needs: environments.sh TEST.py [arguments]
# Exit status 77 if the packages can't be had here.
#   MYOGRADE_TEST_PACKAGES  the list in docker/ of what the test imports: gym (default), gym-oldest,
#                           training, or rl, which is used with Debian's python3-torch
#   MYOGRADE_TEST_PRELOAD  libraries that are loaded first (of the sanitizers), with spaces between
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
packages=${MYOGRADE_TEST_PACKAGES:-gym}
if [ "$packages" = rl ]; then
  if ! /usr/bin/python3 -c 'import importlib.util as u; exit(u.find_spec("torch") is None)'; then
    echo "skipped: Debian's python3-torch is not installed (docker/install_deps.sh packages-rl.txt)"
    exit 77
  fi
  export VENV_OPTIONS=--system-site-packages
fi
list=$root/docker/$packages.txt
venv=$cache/$packages-$(sha256sum "$list" | cut -c1-12)
"$root/docker/make_venv.sh" "$venv" "$list"
pins=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX
exec env GLIBC_TUNABLES="glibc.cpu.hwcaps=$pins" LD_PRELOAD="${MYOGRADE_TEST_PRELOAD:-}" \
  ASAN_OPTIONS="detect_leaks=0:${ASAN_OPTIONS:-}" "$venv/bin/python" -B "$@"
