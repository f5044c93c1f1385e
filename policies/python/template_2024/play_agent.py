"""Plays an agent that was written for the agent template of MyoChallenge 2024.

    play_agent.py AGENT.py [arguments]

The template's modules that only serve its transport (utils, grpc, evaluation_pb2) are found beside
this file, its own files beside AGENT.py."""

import os
import pathlib
import runpy
import sys
import time

from myograde.policy import seeding

HERE = pathlib.Path(__file__).resolve().parent


def main():
    if len(sys.argv) < 2 or not os.path.isfile(sys.argv[1]):
        sys.exit("error: play_agent.py needs the agent's file, as in: play_agent.py agent.py")
    agent = pathlib.Path(sys.argv[1]).resolve()
    changes = "change_osl_mode" in agent.read_text(encoding="utf-8", errors="replace")
    os.environ["MYOGRADE_TEMPLATE_CHANGES_SETS"] = str(int(changes))
    # Until the first episode brings its own: what an agent draws before is the same in each
    # process.
    seeding.seed(0)
    # The real packages win over the stand-ins, our utils over the template's.
    sys.path[:] = [str(HERE), str(agent.parent), *sys.path[1:], str(HERE / "standins")]
    # Agents of 2024 wait a minute for their environment's container; here it is there.
    time.sleep = lambda seconds: None
    sys.argv = sys.argv[1:]
    runpy.run_path(str(agent), run_name="__main__")


main()
