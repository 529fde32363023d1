"""A peer in a process of its own, for a test that freezes it: it answers each message with its length.

Arguments: namespace, folder of the sockets, key, its own name, and the names of all processes in their order.
"""

import sys
import threading
from pathlib import Path

from dlokit.communication.zenoh.session import open_session
from dlokit.system.processes.sockets import LocalBus

if __name__ == "__main__":
    namespace, folder, key, name, *names = sys.argv[1:]
    session = open_session(LocalBus(namespace=namespace, folder=Path(folder), key=key).process(name, names))
    answers = session.declare_publisher("topic/answer")
    heard = session.declare_subscriber("topic/ask", lambda sample: answers.put(str(len(sample.payload)).encode()))
    threading.Event().wait()
