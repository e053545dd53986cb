"""Defaults of the commands, which their help shows: this module imports nothing that is slow."""

from jaxid.search.effort import Effort

ALL = "all"  # target of a design: the largest predicted error relative to its lower bound
BANDWIDTHS = (30.0, 100.0, 300.0, 1000.0, 3000.0)  # rad/s, of the filters of a sweep
FACTORS = (0.5, 1.0, 2.0)  # of the feedback gains of a sweep
# quick without motions of constant speeds: to compile their evolution takes 6 s, and two rounds
# instead reached lower errors (largest gap of four seeds 2.7 % instead of 5.5 % above the best)
EFFORTS = {
    "usual": Effort(),
    "quick": Effort(
        starts=16,
        generations=0,
        rounds=2,
        variations=16,
        finalists=1,
        searches=1,
        predicted_smoothings=(1e-3, 1e-4),
    ),
}
