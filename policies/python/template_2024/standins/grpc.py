"""For agents that import grpc and never use it. The real package is found first."""


def __getattr__(name):
    raise AttributeError(f"grpc.{name}: there is no network here; use RemoteConnection of utils")
