"""Submits policies and reads results over the HTTP API, with only Python's standard library.

    import myograde.client

    server = myograde.client.Client()  # the one that the program myograde would ask
    submission = server.submit("still", track="elbow", team="alpha")
    status = server.wait(submission["submission"], timeout_s=3600)
    records = server.episodes(status["submission"])  # pandas.DataFrame(records) works
"""

from ..errors import DeadlinePassed, MyogradeError, ServerError, Unreachable, WrongUse
from .client import FINAL_STATES, Client
from .ranking import band_openers, packed_score
from .records import flat, marks_of, numbers_of
from .server import Server, choose_server

__all__ = ["FINAL_STATES", "Client", "DeadlinePassed", "MyogradeError", "Server", "ServerError",
           "Unreachable", "WrongUse", "band_openers", "choose_server", "flat", "marks_of", "numbers_of",
           "packed_score"]
