"""`gcs`, also as `python -m gcs_tools`."""

from gcs_tools.cli.program import main

if __name__ == "__main__":
    main()
