"""Run a command on a machine of its own, as far as the network goes: `python alone.py PORT,... COMMAND...`

Started in a new network namespace (`unshare`), where no port is taken and nobody else sends anything.
The ports named are held by somebody else while the command runs.
"""

import fcntl
import os
import socket
import struct
import sys

SIOCSIFFLAGS, IFF_UP, IFF_RUNNING = 0x8914, 1, 64


def main(ports, command):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh14x", b"lo", IFF_UP | IFF_RUNNING)
        fcntl.ioctl(any_socket, SIOCSIFFLAGS, request)
    held = []
    for port in ports:
        held.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        held[-1].bind(("127.0.0.1", port))
        held[-1].set_inheritable(True)  # and so is kept
    os.execvp(command[0], command)


if __name__ == "__main__":
    main([int(port) for port in sys.argv[1].split(",") if port], sys.argv[2:])
