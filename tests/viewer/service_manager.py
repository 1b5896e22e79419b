"""Holds the address of the pages and starts growbot's service again when it ends, as systemd does with the units
growbot.socket and growbot.service.

    python3 service_manager.py GROWBOT

Prints the number of each service's process, and what the service prints.
"""

import os
import socket
import sys

FIRST_PASSED = 3

listener = socket.create_server(("127.0.0.1", 0))
os.dup2(listener.fileno(), FIRST_PASSED)
os.set_inheritable(FIRST_PASSED, True)
while True:
    child = os.fork()
    if child == 0:
        os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1")
        os.execv(sys.argv[1], [sys.argv[1], "serve"])
    print(f"process {child}", flush=True)
    os.waitpid(child, 0)
