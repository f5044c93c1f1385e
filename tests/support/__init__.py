"""Shared by several test folders; none of it is a test.

| module | holds |
|---|---|
| `daemon` | a daemon with its own folders, configs, users and log |
| `client` | HTTP over its Unix socket, also as another user |
| `crowd` | many concurrent clients that hold on to the socket |
| `submission` | archives of submissions, valid and hostile |
| `waiting` | deadlines |
| `proc` | what the kernel reports about processes |
| `fake_runner.py` | a stand-in for myograde-runner that plays without physics |

What is special about a folder's daemons stays in that folder, as a thin layer on these:
integration/system.py, redteam/host.py, bench/grader.py, bench/load/load.py,
server/daemon/daemon_test.py.

tests/ must be on Python's path: CMake's tests have it in PYTHONPATH (tests/CMakeLists.txt), and
scripts that are started by hand add it themselves.
"""
