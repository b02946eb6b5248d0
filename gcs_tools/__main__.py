"""`gcs`, also as `python -m gcs_tools`."""

import sys

from gcs_tools.exit_codes import INTERRUPTED
from gcs_tools.flight.interrupts import ignore, install, interrupts_wait

try:
    install()
    with interrupts_wait():  # what is half imported may fail with any error
        from gcs_tools.cli.program import main
except KeyboardInterrupt:
    ignore()
    sys.exit(INTERRUPTED)

if __name__ == "__main__":
    main()
