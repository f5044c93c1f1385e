#!/usr/bin/env bash
# Looks at the web pages in a headless Chromium: run.sh [TEST ...]
#   MYOGRADE_WEB_TEST  the file with the tests (default: browser_test.py)
# Exit status: 0 all is well, 1 something is not, 77 Chromium or axe-core can't be had here.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
list=$here/../../../docker/axe.txt
tool=$cache/axe-$(sha256sum "$list" | cut -c1-12)

if ! command -v chromium >/dev/null; then
  echo "skipped: there is no Chromium (Debian package chromium; ./dev test --full installs it)."
  exit 77
fi
"$here/../../../docker/make_venv.sh" "$tool" "$list"
axe=("$tool"/lib/python3*/site-packages/axe_playwright_python/axe.min.js)
MYOGRADE_TEST_AXE=${axe[0]} exec /usr/bin/python3 -B "$here/${MYOGRADE_WEB_TEST:-browser_test.py}" "$@"
