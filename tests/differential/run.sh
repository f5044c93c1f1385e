#!/usr/bin/env bash
# The differential test: records the official Python environments on seeds and
# actions that nobody has seen, and lets the golden tests compare ours.
#
# usage: run.sh BUILD_DIR [record.py options]      (BUILD_DIR has the golden tests)
# Exit status: 0 equal, 1 different, 77 the official packages can't be had here.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=${1:?usage: run.sh BUILD_DIR [record.py options]}
shift
cache=${MYOGRADE_CACHE:?MYOGRADE_CACHE is not set: the folder that ./dev setup filled}
official=$cache/official-2.8.4
scratch=$(mktemp -d "${TMPDIR:-/tmp}/myograde-differential.XXXXXX")
trap 'rm -rf "$scratch"' EXIT

"$here/../../docker/make_venv.sh" "$official" "$here/requirements.txt"

"$official/bin/python" -B -W ignore "$here/record.py" --out "$scratch/golden" "$@"
for track in elbow reorientation baoding relocation chasetag; do
  "$official/bin/python" -B -W ignore "$here/record_$track.py" --out "$scratch/golden" "$@"
done
status=0
for test in manipulation_test locomotion_test elbow_test reorientation_test baoding_test relocation_test chasetag_test; do
  MYOGRADE_GOLDEN=$scratch/golden "$build/tests/$test" --gtest_brief=1 \
    --gtest_filter='ManipulationGolden.ResetsStatesAndStepsAgree:LocomotionGolden*:ElbowGolden*:ReorientationGolden*:BaodingGolden*:RelocationGolden*:ChaseTagGolden*' || status=1
done
if [ "$status" != 0 ]; then
  kept=${TMPDIR:-/tmp}/myograde-differential-$$
  mv "$scratch/golden" "$kept"
  echo "The recordings that differ are kept in $kept; ./dev golden $kept compares them again."
fi
exit "$status"
