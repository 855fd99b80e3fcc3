"""The same as ``flametomo calibrate-rig``."""

from tomo.cli import main

if __name__ == "__main__":
    main("calibrate-rig")
