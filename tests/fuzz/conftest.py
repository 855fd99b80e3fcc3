import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent.parent / "rigs" / "recordings"))  # for `film_files`
