"""How long it may take to refuse a file, whatever else the process and the machine have to do."""

import gc
import time
from contextlib import contextmanager


@contextmanager
def takes_less_than(seconds):
    """Require that what is done takes less processor time of its own thread, in seconds.

    Garbage is not collected meanwhile: that takes the longer the more other tests have left.
    """
    gc.disable()
    began = time.thread_time()
    try:
        yield
        taken = time.thread_time() - began
    finally:
        gc.enable()
    assert taken < seconds
