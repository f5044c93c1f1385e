"""The adapters template-2022, template-2023 and template-2024: plays an agent that was written for
the agent template of a MyoChallenge. The grader's bridge starts it in the participant's sandbox, in
the place of a policy:

    python3 -I FOLDER --name ADAPTER --track KIND [--runtime FOLDER ...] [--env NAME=VALUE ...]
        [--cwd FOLDER] [--extra-observations] [--image] -- COMMAND ...

It serves the template's gRPC service on the ports 8085 and 8086 of this machine, starts COMMAND,
the agent, and speaks LCM with the grader. It ends when the agent ends, with its exit status, or
when the grader asks it to. README.md tells what the agent sees."""

import argparse
import os
import signal
import sys

from agent import Agent, agent_environment

# A part of the second that the grader gives a policy to end after its last episode.
FAREWELL_S = 0.7


class AskedToEnd(Exception):
    """SIGTERM: the last episode is over."""


def parse(arguments):
    parser = argparse.ArgumentParser(prog="template")
    parser.add_argument("--name", required=True)  # as policy.json has it
    parser.add_argument("--track", required=True)
    parser.add_argument("--runtime", action="append", default=[])
    parser.add_argument("--env", action="append", default=[])
    parser.add_argument("--cwd", default="/policy")
    parser.add_argument("--extra-observations", action="store_true")
    parser.add_argument("--image", action="store_true")  # the agent has its own packages
    split = arguments.index("--")
    options = parser.parse_args(arguments[:split])
    options.command = arguments[split + 1:]
    return options


def use_runtimes(runtimes):
    """The one with gRPC first: another one's NumPy may be of another version."""
    ranked = sorted(runtimes, key=lambda folder: not os.path.isdir(os.path.join(folder, "grpc")))
    sys.path.extend(ranked)


def end_as(status):
    """Ends this process as the agent ended, without waiting for gRPC's threads."""
    sys.stdout.flush()
    sys.stderr.flush()
    if status < 0:
        signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    os._exit(status if status >= 0 else 128 - status)


def main():
    options = parse(sys.argv[1:])
    environment = agent_environment(options.env, [] if options.image else options.runtime)
    # Before there are threads, as it forks.
    agent = Agent(options.command, environment, options.cwd)
    use_runtimes(options.runtime)
    from service import Service  # what it imports is in the runtimes

    service = Service(options.name, options.track, options.extra_observations)

    def on_term(_signal, _frame):
        service.stop()
        raise AskedToEnd

    try:
        signal.signal(signal.SIGTERM, on_term)
        service.start()
        agent.start()
        status = agent.wait()
    except AskedToEnd:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        agent.end(FAREWELL_S)
        end_as(0)
    end_as(status)


main()
