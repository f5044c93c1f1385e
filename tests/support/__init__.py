"""What several folders of tests share: none of it is a test.

| module | holds |
|---|---|
| `daemon` | a daemon with folders, configs, users and a log of its own |
| `client` | HTTP over its Unix socket, also as another user |
| `crowd` | many clients at once that hold on to the socket |
| `submission` | archives of submissions, honest or not |
| `waiting` | deadlines |
| `proc` | what the kernel tells of processes |
| `fake_runner.py` | a stand-in for myograde-runner that plays without physics |

What is special about a folder's daemons stays in that folder, as a thin layer on these:
integration/system.py, redteam/host.py, bench/grader.py, bench/load/load.py,
server/daemon/daemon_test.py.

tests/ has to be on Python's path: PYTHONPATH of CMake's tests has it (tests/CMakeLists.txt), and
scripts that are started by hand put it there themselves.
"""
