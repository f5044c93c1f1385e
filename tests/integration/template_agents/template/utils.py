"""The classes through which the template's agents speak to their environment, with the same names
and calls on the wire."""

import pickle

import evaluation_pb2
import evaluation_pb2_grpc
import grpc
import gymnasium as gym
import numpy as np


class RemoteConnection:
    _low = -1.0

    def __init__(self, address):
        self.channel = grpc.insecure_channel(address)
        self.stub = evaluation_pb2_grpc.EnvironmentStub(self.channel)
        self._construct_action_and_observation_space()

    def _call(self, name, entity=None):
        package = evaluation_pb2.Package(SerializedEntity=pickle.dumps(entity))
        return pickle.loads(getattr(self.stub, name)(package).SerializedEntity)

    def _construct_action_and_observation_space(self):
        self.set_observation_space((self.get_observation_space(),))
        self.action_space = gym.spaces.Box(shape=(self.get_action_space(),), high=1.0,
                                           low=self._low)

    def set_observation_space(self, shape):
        self.observation_space = gym.spaces.Box(shape=shape, high=1e6, low=-1e6)

    def set_environment_keys(self, new_env_keys):
        self._call("set_environment_keys", new_env_keys)
        self._construct_action_and_observation_space()

    def set_output_keys(self, new_out_keys):
        self._call("set_output_keys", new_out_keys)
        self._construct_action_and_observation_space()

    def get_action_space(self):
        return self._call("get_action_space")

    def get_observation_space(self):
        return self._call("get_observation_space")

    def get_obsdict(self):
        return self._call("get_obsdict")

    def reset(self):
        return self._call("reset")

    def act_on_environment(self, action):
        return self._call("act_on_environment", action)

    def obsdict2obsvec(self, obs_dict, ordered_obs_keys):
        return np.concatenate([np.zeros(0), *(obs_dict[key].ravel() for key in ordered_obs_keys)])


class LocoRemoteConnection(RemoteConnection):
    _low = 0.0

    def reset(self, reset_dict=None):
        return self._call("reset", reset_dict)

    def change_osl_mode(self, mode):
        self._call("change_osl_mode", mode)


class DummyManiEnv:
    def __init__(self, env_name, stub):
        self.env_name = env_name
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (stub.get_observation_space(),))
        self.action_space = gym.spaces.Box(-1, 1, (stub.get_action_space(),))
