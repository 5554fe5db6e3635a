"""What would run code of somebody else's, if anything here unpickled it."""

import pickle
from pathlib import Path


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self):
        return Path.touch, (self.trace,)


def payload(trace: Path) -> bytes:
    """A pickle that would leave `trace`; it does where one unpickles it."""
    data = pickle.dumps(Payload(trace))
    pickle.loads(data)
    assert trace.exists()
    trace.unlink()
    return data
