"""Types lines into a program at a terminal: typed.py N (TEXT LINE)... PROGRAM ARGUMENTS...

N is how many words TEXT and LINE are. A line is typed once the program has written its text since the line
before. The program then ends by itself, or is ended with this one. The line (end) ends it, for one that ignores being
asked to.
"""

from __future__ import annotations

import os
import pty
import re
import signal
import sys

END = "(end)"


def main() -> int:
    """The program's exit code."""
    count = int(sys.argv[1])
    words, program = sys.argv[2 : 2 + count], sys.argv[2 + count :]
    lines = list(zip(words[::2], words[1::2], strict=True))
    child, terminal = pty.fork()
    if child == 0:
        os.execvp(program[0], program)
    written = ""
    while True:
        try:
            got = os.read(terminal, 65536).decode(errors="replace")
        except OSError:  # the program has closed its terminal
            got = ""
        if not got:
            break
        sys.stdout.write(got)
        sys.stdout.flush()
        written += got
        while lines and re.search(lines[0][0], written):
            written, line = "", lines.pop(0)[1]
            if line == END:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return 0
            os.write(terminal, line.encode() + b"\n")
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == "__main__":
    sys.exit(main())
