"""The same as ``flametomo view``."""

from tomo.cli import main

if __name__ == "__main__":
    main("view")
