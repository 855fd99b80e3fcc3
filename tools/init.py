"""The same as ``flametomo init``."""

from tomo.cli import main

if __name__ == "__main__":
    main("init")
