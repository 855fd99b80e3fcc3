"""How good the volumes of a film are, with all that choosing takes."""

from tomo import Options, reconstruct
from tomo.metrics import nrmse
from tomo.series import make_plan
from tomo.series.frames import reader_of
from tomo.series.run import solve_block


def test_volumes_are_as_good_as_those_of_single_frames(film, as_given):
    plan = make_plan(film.scan, film.grid, film.options, tuple(range(len(film.truths))))
    read, block = reader_of(plan.scan, plan.screened), range(8, 11)
    found = dict(solve_block(plan, block, [read(place) for place in block]))
    for place in (8, 9):
        options = Options(frame=f"frame_{place:03d}", hold_out=film.options.hold_out, **as_given)
        alone = reconstruct(film.scan, options=options)
        ours = nrmse(found[place].volume, film.truths[place])
        assert ours < 1.1 * nrmse(alone.volume, film.truths[place])
        assert ours < 0.1
