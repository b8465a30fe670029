"""The process between bubblewrap and its program. Run as a program; see keeper.py.

Bubblewrap reports a signal as the exit code 128 + n, which a program may also exit with. This
parent of the program reports which it was on descriptor 3, which the program does not get. A
program may kill the reporter or write there in its name, but then only falsifies its own ending.
"""

import os
import sys

#: The descriptor that the keeper reads.
ENDING = 3


def main() -> int:
    """Run sys.argv[1:] and report its exit code, negative for the signal that ended it."""
    child = os.fork()
    if child == 0:
        try:
            os.setpgid(0, 0)  # a program that kills its group leaves its reporter
            os.close(ENDING)
            os.execv(sys.argv[1], sys.argv[1:])
        except OSError as error:
            os.write(2, f"{sys.argv[1]}: {error}\n".encode())
        finally:
            os._exit(127)
    _, status = os.waitpid(child, 0)
    os.write(ENDING, b"%d\n" % os.waitstatus_to_exitcode(status))
    return 0


if __name__ == "__main__":
    sys.exit(main())
