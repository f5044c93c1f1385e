"""What the template packs its messages in. An agent may send anything; it is read in its own
sandbox, by a process that has no more rights than the agent itself."""

import pickle

# Read by every Python from 3.4 on; the arrays are NumPy 1's, which NumPy 2 reads as well.
_PROTOCOL = 4


def pack(value):
    return pickle.dumps(value, protocol=_PROTOCOL)


def unpack(data):
    """ValueError with a sentence if it can't be read here."""
    try:
        return pickle.loads(data)
    except ImportError as error:
        raise ValueError(f"the message needs {error.name}, which the environment does not have; "
                         "send NumPy arrays, numbers, lists and dictionaries") from error
    except Exception as error:
        raise ValueError(f"the message can't be unpickled ({error})") from error
