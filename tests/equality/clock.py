"""Run a module by a clock that stands until its starter sets it: `python clock.py FILE MODULE ARGUMENT...`

FILE holds nanoseconds as an int64. Python reads them as `time.monotonic` and `time.time`, compiled code
as libc's `clock_gettime`: what a process sends by the wall clock then repeats to the byte.
"""

import ctypes
import mmap
import runpy
import struct
import sys
import time

SINCE_1970_S = 1_700_000_000
REALTIME = 0  # of the clocks that `clock_gettime` knows


def main(path, module, arguments):
    with open(path, "r+b") as file:
        shared = mmap.mmap(file.fileno(), 8)

    def told(clock):
        seconds, nanoseconds = divmod(struct.unpack("<q", shared)[0], 1_000_000_000)
        return seconds + (SINCE_1970_S if clock == REALTIME else 0), nanoseconds

    def read(clock):
        seconds, nanoseconds = told(clock)
        return seconds + 1e-9 * nanoseconds

    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_int64))
    def clock_gettime(clock, to):
        to[0], to[1] = told(clock)
        return 0

    time.monotonic = lambda: read(REALTIME + 1)
    time.time = lambda: read(REALTIME)
    sys.path[0] = ""  # as of `python -m`
    from llvmlite import binding

    binding.add_symbol("clock_gettime", ctypes.cast(clock_gettime, ctypes.c_void_p).value)
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
