"""One thread that does what was asked last of each kind, so that sliders do not queue up."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Worker:
    """Does one job after the other; a job of a kind replaces one that still waits.

    Parameters
    ----------
    failed : callable
        Called with the error of a job that failed.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._jobs: dict[str, Callable[[], None]] = {}
        self._change = threading.Condition()
        self._is_busy = self._ends = False
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"<Worker: {len(self._jobs)} jobs wait>"

    def ask(self, kind: str, job: Callable[[], None]) -> None:
        """Do a job when those before it are done; one of its kind that waits is dropped."""
        with self._change:
            self._jobs[kind] = job
            self._change.notify_all()

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits and nothing is being done."""
        return not self._jobs and not self._is_busy

    def wait(self, seconds: float = 60.0) -> bool:
        """Wait until nothing is left to do; return whether that is so."""
        with self._change:
            return self._change.wait_for(lambda: self.is_idle, seconds)

    def stop(self) -> None:
        """Drop what waits, and end after the job at hand."""
        with self._change:
            self._jobs.clear()
            self._ends = True
            self._change.notify_all()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._jobs or self._ends)
                if self._ends:
                    return
                job = self._jobs.pop(next(iter(self._jobs)))
                self._is_busy = True
            try:
                job()
            except Exception as error:
                self._failed(error)
            finally:
                with self._change:
                    self._is_busy = False
                    self._change.notify_all()
