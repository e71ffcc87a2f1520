# SPDX-License-Identifier: Apache-2.0
"""Ports for tests in Python, as ports.h has them for tests in C++. Both use the same claims."""
import contextlib
import errno
import random
import socket
import time

CLAIMS = []  # a claim lasts as long as its socket, and the sockets as long as the process


def own_port():
    """A port number reserved for this process until it ends, as TCP and as UDP port. No process listens on it now."""
    begin = random.SystemRandom().randrange(10000)  # a test that sets a seed does not draw the same ports every time
    for i in range(10000):
        port = 20000 + (begin + i) % 10000
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0slabd-test-port-{port}")
            for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
                with socket.socket(socket.AF_INET, kind) as s:
                    s.bind(("", port))
        except OSError:
            claim.close()
            continue
        CLAIMS.append(claim)
        return port
    raise RuntimeError("no free port")


@contextlib.contextmanager
def alone(name):
    """Waits until no other process is in a block of this name, for a program whose port is fixed. As for ports, the name
    is an abstract socket: it belongs to a network namespace, has no permissions, and ends with the process."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        while True:
            try:
                claim.bind(f"\0slabd-test-{name}")
                break
            except OSError as why:
                if why.errno != errno.EADDRINUSE:
                    raise
            time.sleep(0.2)
        yield
