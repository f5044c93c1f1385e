"""Control steps per second of one environment, of others or ours, with the zero action.

    one.py {myosuite,envpool,loop,vector} {manipulation,locomotion} [--environments N]

Run by others.py in the Python that has the packages. Prints {} when it is warm; then, for each line
of standard input, which is a number of steps, plays them and prints one JSON object. Only steps are
timed; what a reset takes is left out, but for EnvPool and our vector environment, which reset within
a step."""

import argparse
import concurrent.futures
import contextlib
import io
import json
import os
import pickle
import subprocess
import sys
import time

os.environ.setdefault("MUJOCO_GL", "disabled")

import numpy as np  # noqa: E402  (after the choice of no renderer)

NAMES = {"manipulation": "myoChallengeBimanual-v0", "locomotion": "myoChallengeOslRunRandom-v0"}
OURS = {"manipulation": "myograde/Manipulation-v0", "locomotion": "myograde/Locomotion-v0"}
WARM_UP = 20
SEED = 1
SERVICE = "bench.Environment"
CALL_S = 120  # deadline of a call


def official(track):
    """The official environment, without its banner."""
    with contextlib.redirect_stdout(io.StringIO()):
        import gymnasium
        import myosuite  # noqa: F401  (registers the environments)
        return gymnasium.make(NAMES[track])


def play(reset, step, action):
    """The function that plays so many steps and says how many seconds they took, by the clock and of
    this process' CPU time, and how often an episode ended in them."""
    reset()

    def turn(steps):
        seconds, cpu, ends = 0.0, 0.0, 0
        for _ in range(steps):
            start, cpu_start = time.perf_counter(), time.process_time()
            _, _, terminated, truncated, _ = step(action)
            cpu += time.process_time() - cpu_start
            seconds += time.perf_counter() - start
            if terminated or truncated:
                ends += 1
                reset()
        return {"steps": steps, "seconds": seconds, "cpu_seconds": cpu, "ends": ends}
    return turn


def take_turns(turn):
    """Plays as standard input says, until it ends."""
    turn(WARM_UP)
    print("{}", flush=True)
    for line in sys.stdin:
        print(json.dumps(turn(int(line))), flush=True)


def myosuite_env(options):
    env = official(options.track)
    take_turns(play(lambda: env.reset(seed=SEED), env.step, np.zeros(env.action_space.shape)))


def envpool_env(options):
    import envpool
    count = options.environments
    env = envpool.make(NAMES[options.track], env_type="gymnasium", num_envs=count,
                       num_threads=count, seed=SEED)
    env.reset()
    take_turns(play_many(env, count, np.zeros((count, *env.action_space.shape),
                                              env.action_space.dtype)))


def vector_env(options):
    """Ours as people get it from Gymnasium: with the official rules for the end of an episode, in
    C++ threads, and with new arrays from each step."""
    import myograde
    import myograde.envs
    if not myograde.envs.exact():
        sys.exit("the maths functions are not the grader's")
    count = options.environments
    env = myograde.vec(OURS[options.track], count, threads=count, profile="myosuite")
    env.reset(seed=SEED)
    take_turns(play_many(env, count, np.zeros(env.action_space.shape)))


def play_many(env, count, action):
    """The same as play() of environments that are stepped together and restart by themselves."""
    def turn(steps):
        ends, start, cpu_start = 0, time.perf_counter(), time.process_time()
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(action)
            ends += int(np.sum(terminated | truncated))
        return {"steps": steps * count, "seconds": time.perf_counter() - start,
                "cpu_seconds": time.process_time() - cpu_start, "ends": ends}
    return turn


# --- the official style of loop: the environment behind gRPC, pickled arrays in its messages ---


def serve(track):
    """Serves one environment on a port that it prints; ends when its standard input does."""
    import grpc
    env = official(track)
    methods = {"reset": lambda seed, _: env.reset(seed=seed), "step": lambda a, _: env.step(a),
               "shape": lambda *_: env.action_space.shape}
    handler = grpc.method_handlers_generic_handler(SERVICE, {
        name: grpc.unary_unary_rpc_method_handler(call, pickle.loads, pickle.dumps)
        for name, call in methods.items()})
    server = grpc.server(concurrent.futures.ThreadPoolExecutor(max_workers=1))
    server.add_generic_rpc_handlers((handler,))
    print(server.add_insecure_port("127.0.0.1:0"), flush=True)
    server.start()
    sys.stdin.read()
    server.stop(0)


def loop_env(options):
    import grpc
    with subprocess.Popen([sys.executable, "-B", "-W", "ignore", __file__, "serve", options.track],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        try:
            with grpc.insecure_channel(f"127.0.0.1:{int(server.stdout.readline())}") as channel:
                def call(name, value):
                    method = channel.unary_unary(f"/{SERVICE}/{name}", pickle.dumps, pickle.loads)
                    return method(value, timeout=CALL_S, wait_for_ready=True)
                action = np.zeros(call("shape", "of an action"))
                take_turns(play(lambda: call("reset", SEED), lambda a: call("step", a), action))
        finally:
            server.stdin.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("myosuite", "envpool", "loop", "vector", "serve"))
    parser.add_argument("track", choices=tuple(NAMES))
    parser.add_argument("--environments", type=int, default=1, help="of EnvPool and ours, a thread each")
    options = parser.parse_args()
    if options.what == "serve":
        serve(options.track)
        return
    measure = {"myosuite": myosuite_env, "envpool": envpool_env, "loop": loop_env,
               "vector": vector_env}[options.what]
    measure(options)


if __name__ == "__main__":
    main()
