import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent / "rigs" / "recordings")]  # for `samples`, `film_files`
