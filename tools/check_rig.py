"""The same as ``flametomo check-rig``."""

from tomo.cli import main

if __name__ == "__main__":
    main("check-rig")
