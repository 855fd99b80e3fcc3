"""The same as ``flametomo reconstruct``."""

from tomo.cli import main

if __name__ == "__main__":
    main("reconstruct")
