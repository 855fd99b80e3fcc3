"""The same as ``flametomo simulate``."""

from tomo.cli import main

if __name__ == "__main__":
    main("simulate")
