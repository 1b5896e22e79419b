"""Holds the address of the pages and starts growbot's service, as systemd does with the units growbot.socket and
growbot.service. It starts the service for each line of its standard input, if the service before has ended. At a line
`new socket` it gives the address up first and takes it again, like a machine without these units.

    python3 service_manager.py GROWBOT

Prints the number of each service's process, what the service prints, and its end.
"""

import os
import socket
import sys

FIRST_PASSED = 3


def listen(address):
    """Returns a listening socket with the number at which the service expects it."""
    number = socket.create_server(address).detach()
    if number != FIRST_PASSED:
        os.dup2(number, FIRST_PASSED)
        os.close(number)
    os.set_inheritable(FIRST_PASSED, True)
    return socket.socket(fileno=FIRST_PASSED)


listener = listen(("127.0.0.1", 0))
for line in sys.stdin:
    if line.strip() == "new socket":
        address = listener.getsockname()
        listener.close()
        listener = listen(address)
    child = os.fork()
    if child == 0:
        os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1")
        os.execv(sys.argv[1], [sys.argv[1], "serve"])
    print(f"process {child}", flush=True)
    os.waitpid(child, 0)
    print("ended", flush=True)
