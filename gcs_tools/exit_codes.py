"""What the programs exit with, and what a Result says of its flight."""

OK = 0
MISSED = 1  # an expectation was not met
USAGE = 2  # a bad command line, mission or file
INFRASTRUCTURE = 3  # not the flight failed, what flies it did
INTERRUPTED = 130
