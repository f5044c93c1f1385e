#!/bin/sh
# Builds the policy and puts what is submitted into the folder submission.
#   build.sh [OPTION OF CMAKE ...]     such as -DCMAKE_PREFIX_PATH=PREFIX, where MyoGrade is
#                                      installed, if its bin folder is not on the PATH
set -eu
cd "$(dirname "$0")"
cmake -S . -B build "$@"
cmake --build build
rm -rf submission
cmake --install build --prefix submission
