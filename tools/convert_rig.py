"""The same as ``flametomo convert-rig``."""

from tomo.cli import main

if __name__ == "__main__":
    main("convert-rig")
