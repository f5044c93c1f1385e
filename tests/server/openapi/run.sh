#!/usr/bin/env bash
# Lets schemathesis try the daemon's API: run.sh [--full]
# Exit status: 0 as described, 1 not, 77 schemathesis can't be had here.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
tool=$cache/schemathesis-$(sha256sum "$here/requirements.txt" | cut -c1-12)

"$here/../../../docker/make_venv.sh" "$tool" "$here/requirements.txt"
MYOGRADE_TEST_SCHEMATHESIS=$tool/bin/st exec /usr/bin/python3 -B "$here/schemathesis_test.py" "$@"
