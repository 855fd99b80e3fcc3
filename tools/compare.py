"""The same as ``flametomo compare``."""

from tomo.cli import main

if __name__ == "__main__":
    main("compare")
