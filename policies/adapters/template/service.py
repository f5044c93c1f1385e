"""The gRPC service evaluation.Environment of the templates. Each method takes and returns one
message with one field, the bytes `SerializedEntity` with the number 1: on the wire the same as
protobuf's own BytesValue. evaluation.proto has the service for reference."""

import sys
import traceback
from concurrent import futures

import grpc
from google.protobuf.wrappers_pb2 import BytesValue

from connection import EvaluationOver, Stop
from environment import Refused, environment_of
from pickles import pack, unpack

# The templates' addresses are localhost and environment, 8085 for a challenge's first task
# (reorientation, relocation, manipulation) and 8086 for its second (Baoding balls, chase-tag,
# locomotion); each agent is served on both.
_PORTS = (8085, 8086)
_HOSTS = ("127.0.0.1", "[::1]")
_SERVICE = "evaluation.Environment"
SEED_KEY = "myograde-policy-seed"


class Service:
    """Serves one agent. One thread answers all calls, one after the other, as the templates'
    environments do."""

    def __init__(self, name, track, extra_observations):
        self._stop = Stop()
        self._environment = environment_of(name, track, extra_observations, self._stop)
        self._server = grpc.server(futures.ThreadPoolExecutor(max_workers=1),
                                   options=[("grpc.so_reuseport", 0)])
        methods = {name: self._handler(name) for name in self._environment.CALLS}
        self._server.add_generic_rpc_handlers(
            (grpc.method_handlers_generic_handler(_SERVICE, methods),))

    def start(self):
        for port in _PORTS:
            self._server.add_insecure_port(f"{_HOSTS[0]}:{port}")
            try:
                self._server.add_insecure_port(f"{_HOSTS[1]}:{port}")
            except RuntimeError:
                pass  # a host without IPv6
        self._server.start()

    def stop(self):
        """The call that waits for the grader is answered, and no further one is."""
        self._stop.set()

    def _handler(self, name):
        method = getattr(self._environment, name)

        def answer(request, context):
            try:
                # An empty message is what the template's stubs send where there is nothing to say.
                result = method(unpack(request.value) if request.value else None)
                if name == "reset":
                    seed = str(self._environment.policy_seed)
                    context.set_trailing_metadata(((SEED_KEY, seed),))
                return BytesValue(value=pack(result))
            except (Refused, ValueError) as error:
                refuse(context, grpc.StatusCode.INVALID_ARGUMENT, f"{name}: {error}")
            except EvaluationOver:
                context.abort(grpc.StatusCode.UNAVAILABLE, "the last episode is over")
            except SystemExit as error:
                refuse(context, grpc.StatusCode.FAILED_PRECONDITION, str(error))
            except Exception as error:  # of what the agent sent: its own objects can do anything
                traceback.print_exc()
                refuse(context, grpc.StatusCode.UNKNOWN, f"{name}: {error}")

        return grpc.unary_unary_rpc_method_handler(
            answer, request_deserializer=BytesValue.FromString,
            response_serializer=BytesValue.SerializeToString)


def refuse(context, code, sentence):
    print(f"template: {sentence}", file=sys.stderr, flush=True)
    context.abort(code, sentence)
