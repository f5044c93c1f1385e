"""The template's stub: a method of the channel for each call of the service."""

import evaluation_pb2

_CALLS = ("reset", "get_action_space", "get_observation_space", "get_obsdict", "act_on_environment",
          "get_output_keys", "set_output_keys", "set_environment_keys", "change_osl_mode")


class EnvironmentStub:
    def __init__(self, channel):
        for call in _CALLS:
            setattr(self, call, channel.unary_unary(
                f"/evaluation.Environment/{call}",
                request_serializer=evaluation_pb2.Package.SerializeToString,
                response_deserializer=evaluation_pb2.Package.FromString))
