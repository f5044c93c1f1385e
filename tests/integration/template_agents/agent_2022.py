"""An agent in the form that the 2022 template asks for, by stubs alone: it prints the keys of its
environment, tries one of them, and plays with all. Arguments: the port, a key and its size."""

import pickle
import sys
import time

import evaluation_pb2
import evaluation_pb2_grpc
import grpc
import numpy as np


def call(name, entity=None):
    package = evaluation_pb2.Package(SerializedEntity=pickle.dumps(entity))
    return pickle.loads(getattr(stub, name)(package).SerializedEntity)


port, key, size = sys.argv[1:]
time.sleep(30)
stub = evaluation_pb2_grpc.EnvironmentStub(grpc.insecure_channel(f"localhost:{port}"))
keys = call("get_output_keys")
print(f"keys: {' '.join(keys)}", file=sys.stderr, flush=True)
assert call("get_action_space") == 39
whole = call("reset")
assert isinstance(whole, np.ndarray) and whole.any(), whole
assert call("set_output_keys", [key]) is None
assert call("get_output_keys") == [key, "act"]
part = call("reset")
assert part.shape == (int(size) + 39,), part.shape
assert np.array_equal(part[:int(size)], whole[:int(size)])
call("set_output_keys", keys)
over, rewards = False, []
while not over:
    observation, ended = call("reset"), False
    assert observation.shape == whole.shape
    while not ended:
        base = call("act_on_environment", np.zeros(39))
        observation, reward, ended = base["feedback"]
        over = base["eval_completed"]
        rewards.append(reward)
        assert observation.shape == whole.shape
assert min(rewards) < 0.0, rewards
print("all trials are over", file=sys.stderr, flush=True)
