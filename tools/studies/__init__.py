"""Studies of the toolkit: what ``benchmark.py``, ``stress.py`` and ``paper.py`` measure."""
