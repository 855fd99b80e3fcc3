"""What the project sets out to reach, each beside what this run found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from _results import Studies, judged

from _benchmark.scaling import MACHINE
from _benchmark.startup import first_use
from _benchmark.tables import significant


@dataclass(frozen=True)
class Claim:
    """One aim.

    Attributes
    ----------
    what : str
    found : float or None
        None where the run could not tell: it never got there.
    wanted : float
    at_least : bool
        Whether ``found`` has to be at least or at most ``wanted``.
    unit : str
    """

    what: str
    found: float | None
    wanted: float
    at_least: bool = True
    unit: str = "x"

    @property
    def met(self) -> bool:
        """Whether it was reached."""
        if self.found is None:
            return False
        return self.found >= self.wanted if self.at_least else self.found <= self.wanted

    def row(self) -> dict[str, Any]:
        """Return it as plain data."""
        sign = "at least" if self.at_least else "at most"
        found = "never" if self.found is None else f"{significant(self.found)} {self.unit}"
        return {
            "what": self.what,
            "wanted": f"{sign} {self.wanted:g} {self.unit}".rstrip(),
            "found": found.rstrip(),
            "value": self.found,
            "met": self.met,
        }


def claims(studies: Studies) -> list[dict[str, Any]]:
    """Return the aims that the studies at hand say something about."""
    return judged(studies, _JUDGES)


def ratio(over: float | None, under: float | None) -> float | None:
    """Return ``over / under``; None where either is missing."""
    return None if over is None or not under else over / under


def _projectors(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        where = f"{row['voxels']}^3 voxels, {row['what']}"
        match row["what"]:
            case "on the fly forward" if row["threads"] == 1:
                yield Claim(f"{where}: rate over the plain walk's", row["ratio"], 2.5)
            case "on the fly adjoint" if row["threads"] == 1:
                yield Claim(f"{where}: rate over the forward's", row["ratio"], 0.5)
            case "itk-rtk Joseph forward":
                yield Claim(f"{where}: the exact rate over it", ratio(1, row["ratio"]), 3)
            case "stored forward":
                yield Claim(f"{where}: share of the read bandwidth", row["bandwidth_share"], 0.7)
                yield Claim(f"{where}: rate over scipy's", row["ratio"], 1.7)
        if row["what"].startswith("on the fly") and row["threads"] == 2:
            same = (row["what"], row["voxels"], 1)
            one = next(r for r in rows if (r["what"], r["voxels"], r["threads"]) == same)
            found = ratio(one["seconds"], row["seconds"])
            yield Claim(f"{where}: two threads over one", found, 1.8)


def _threads(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        if row["threads"] == 2 and row["form"] != MACHINE:
            what = f"{row['form']} {row['product']}: two threads over one"
            yield Claim(what, row["speed_up"], 1.8)


def _memory(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        if "peak_bytes" in row:
            case = f"{row['edge']}^3 voxels, {row['views']} views of {row['pixels']}^2"
            found = ratio(row["peak_bytes"], row["needed_bytes"])
            what = f"{case}, on the fly: memory over images and two volumes"
            yield Claim(what, found, 1.5, at_least=False)


def _skipping(rows: Sequence) -> Iterator[Claim]:
    for flame, noise in dict.fromkeys((row["flame"], row["noise"]) for row in rows):
        mine = [row for row in rows if (row["flame"], row["noise"]) == (flame, noise)]
        on, off = ([row for row in mine if row["skip"] is skip] for skip in (True, False))
        default, plain = (next(r for r in both if r["method"] == "auto") for both in (on, off))
        where = f"{flame}, {noise}"
        if noise == "clean":
            what = f"{where}: segments without skipping over with"
            yield Claim(what, ratio(plain["segments"], default["segments"]), 4)
            quickest = [_least(row["seconds_to_1e3"] for row in both) for both in (off, on)]
            what = f"{where}, quickest method: time to 1e-3 without skipping over with"
            yield Claim(what, ratio(*quickest), 3)
        most = 1.02 if noise == "clean" else 1.0
        what = f"{where}, default: final cosine distance with skipping over without"
        found = ratio(default["cosine_distance"], plain["cosine_distance"])
        yield Claim(what, found, most, at_least=False)


def _plume(rows: Sequence) -> Iterator[Claim]:
    plain = {(row["frame"], row["held_out"]): row for row in rows if not row["skip"]}
    for row in rows:
        other = plain.get((row["frame"], row["held_out"]))
        if not row["skip"] or other is None:
            continue
        where = f"plume, {row['frame']} without {row['held_out']}"
        yield Claim(
            f"{where}: time without skipping over with", other["seconds"] / row["seconds"], 5
        )
        lost = other["psnr"] - row["psnr"]
        yield Claim(f"{where}: PSNR lost by skipping", lost, 0.1, at_least=False, unit="dB")
        yield Claim(f"{where}: PSNR", row["psnr"], 30.5, unit="dB")
        yield Claim(f"{where}: time", row["seconds"], 10, at_least=False, unit="s")


def _basis(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        where = f"{row['flame']}, {row['views']} views, {row['noise']}"
        yield Claim(f"{where}: distance by splines over by boxes", row["ratio"], 1, False)
        if (row["views"], row["noise"]) == (33, "clean"):
            what = f"{where}, default: distance over the best classic's, best-stopped"
            yield Claim(what, row["of_stopped"], 1.01, at_least=False)


def _consistent(rows: Sequence) -> Iterator[Claim]:
    for flame in dict.fromkeys(row["flame"] for row in rows):
        mine = [row for row in rows if row["flame"] == flame]
        plain = next(row for row in mine if row["method"] == "sirt" and not row["skip"])
        others = [row for row in mine if row["method"] != "sirt"]
        coarse = _least(row["seconds_to_1e3"] for row in others)
        fine = _least(row["seconds_to_1e6"] for row in others)
        what = f"{flame}, exact data: unskipped SIRT's time to 1e-3 over the quickest method's"
        yield Claim(what, ratio(plain["seconds_to_1e3"], coarse), 10)
        what = f"{flame}, exact data: time to 1e-6"
        yield Claim(what, fine, 5, at_least=False, unit="s")


def _default(rows: Sequence) -> Iterator[Claim]:
    wanted = {"jet": 0.99, "turbulent": 0.97}
    for row in rows:
        if (row["method"], row["noise"], row["views"]) == ("auto", "gaussian", 33):
            where = f"{row['flame']}, 33 views, 10 % noise, default"
            similarity = 1 - row["cosine_distance"]
            yield Claim(f"{where}: cosine similarity", similarity, wanted[row["flame"]], unit="")
            what = f"{where}: distance over best-stopped ART's"
            yield Claim(what, row["of_best_art"], 0.25, at_least=False)


def _mismatch(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        wanted = 1 / 3 if row["effect"] == "gains" else 1 / 5
        if row["effect"] in ("vignetting", "defocus", "pixel area"):
            wanted = 1.0
        where = f"{row['flame']}, {row['noise']}, {row['effect']}"
        what = f"{where}: WERNet's distance over the best classic's, best-stopped"
        yield Claim(what, row["wernet_of_classic"], wanted, at_least=False)


def _training(rows: Sequence) -> Iterator[Claim]:
    for row in rows:
        where = f"WERNet's training, jet, {row['variant']}"
        if row["layout"] == "packed" and row["skip"] and row["device"] == "cpu":
            what = f"{where}: time of an epoch padded and unskipped over packed and skipped"
            yield Claim(what, row["times_faster"], 8)
        if row["gradient_difference"] is not None:
            what = f"{where}: gradients packed from those padded, relative"
            yield Claim(what, row["gradient_difference"], 1e-5, at_least=False, unit="")


def _startup(rows: Sequence) -> Iterator[Claim]:
    if any("empty" in row for row in rows if row["what"] == "kernels"):
        yield Claim("first use of every kernel", first_use(rows, "empty"), 20, False, "s")
    yield Claim("the same from the cache", first_use(rows, "warm"), 1, False, "s")


def _least(values: Iterator[float | None]) -> float | None:
    return min((value for value in values if value is not None), default=None)


_JUDGES: tuple[tuple[tuple[str, ...], Callable[..., Iterator[Claim]]], ...] = (
    (("projectors",), _projectors),
    (("threads",), _threads),
    (("memory_target",), _memory),
    (("skipping",), _skipping),
    (("plume",), _plume),
    (("basis_mean",), _basis),
    (("consistent",), _consistent),
    (("solvers_mean",), _default),
    (("startup",), _startup),
    (("mismatch_mean",), _mismatch),
    (("training",), _training),
)
