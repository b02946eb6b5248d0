"""`gcs`, also as `python -m gcs_tools`."""

try:
    from gcs_tools.flight.interrupts import install, interrupts_wait

    install()
    with interrupts_wait():  # what is half imported may fail with any error
        from gcs_tools.cli.program import main
except KeyboardInterrupt:
    import os

    os._exit(
        130
    )  # as exit_codes.INTERRUPTED; nothing has begun; whatever is half imported is left alone

if __name__ == "__main__":
    main()
