"""`gcs`, also as `python -m gcs_tools`."""

import sys

from gcs_tools.exit_codes import INTERRUPTED

try:
    from gcs_tools.cli.program import main
except KeyboardInterrupt:  # before it is there to hear it
    sys.exit(INTERRUPTED)

if __name__ == "__main__":
    main()
