"""Holds the address of the pages and starts growbot's service, as systemd does with the units growbot.socket and
growbot.service. It starts the service for each line of its standard input, if the service before has ended.

    python3 service_manager.py GROWBOT

Prints the number of each service's process, what the service prints, and its end.
"""

import os
import socket
import sys

FIRST_PASSED = 3

listener = socket.create_server(("127.0.0.1", 0))
os.dup2(listener.fileno(), FIRST_PASSED)
os.set_inheritable(FIRST_PASSED, True)
for _ in sys.stdin:
    child = os.fork()
    if child == 0:
        os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1")
        os.execv(sys.argv[1], [sys.argv[1], "serve"])
    print(f"process {child}", flush=True)
    os.waitpid(child, 0)
    print("ended", flush=True)
