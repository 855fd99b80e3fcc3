"""The same as ``flametomo visualize-volume``."""

from tomo.cli import main

if __name__ == "__main__":
    main("visualize-volume")
