"""The same as ``flametomo export``."""

from tomo.cli import main

if __name__ == "__main__":
    main("export")
