"""The same as ``flametomo visualize-rig``."""

from tomo.cli import main

if __name__ == "__main__":
    main("visualize-rig")
