#!/usr/bin/env bash
# Makes a virtual environment of pinned packages in the cache, unless it is there.
#   make_venv.sh FOLDER REQUIREMENTS [REQUIREMENTS ...]
#   VENV_OPTIONS  options of python3 -m venv, such as --system-site-packages
# Exit status 77, pip's last lines and a sentence on standard output if that can't be done here.
set -euo pipefail
folder=${1:?usage: make_venv.sh FOLDER REQUIREMENTS ...}
shift
[ ! -e "$folder/complete" ] || exit 0
# One process makes it; others wait for that one, and find it made.
mkdir -p "$(dirname "$folder")"
exec 9>"$folder.lock"
if ! flock -w 900 9; then
  echo "skipped: another process has been making $(basename "$folder") for 15 minutes."
  exit 77
fi
[ ! -e "$folder/complete" ] || exit 0
log=$(mktemp)
trap 'rm -f "$log"' EXIT
echo "Getting packages for $(basename "$folder") ..."
rm -rf "$folder"
# -I: else pip takes a package of PYTHONPATH for installed.
if ! { /usr/bin/python3 -m venv ${VENV_OPTIONS:-} "$folder" &&
  "$folder/bin/python" -I -m pip install -q --disable-pip-version-check --no-deps --only-binary :all: \
    --require-hashes "${@/#/--requirement=}" && touch "$folder/complete"; } >"$log" 2>&1; then
  tail -n 3 "$log"
  echo "skipped: the packages can't be installed here; pip's last lines are above."
  exit 77
fi
