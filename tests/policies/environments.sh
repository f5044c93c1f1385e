#!/usr/bin/env bash
# Runs a Python test with pinned Gymnasium, the grader's maths functions, and what the sanitized
# extension needs: environments.sh TEST.py [arguments]
# Exit status 77 if Gymnasium can't be had here.
#   MYOGRADE_TEST_PRELOAD  libraries that are loaded first (of the sanitizers), with spaces between
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
venv=$cache/gym-$(sha256sum "$root/docker/gym.txt" | cut -c1-12)
"$root/docker/make_venv.sh" "$venv" "$root/docker/gym.txt"
pins=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX
exec env GLIBC_TUNABLES="glibc.cpu.hwcaps=$pins" LD_PRELOAD="${MYOGRADE_TEST_PRELOAD:-}" \
  ASAN_OPTIONS="detect_leaks=0:${ASAN_OPTIONS:-}" "$venv/bin/python" -B "$@"
