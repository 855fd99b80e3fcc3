"""The same as ``flametomo hull``."""

from tomo.cli import main

if __name__ == "__main__":
    main("hull")
