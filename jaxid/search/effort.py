"""The effort of a search for a motion."""

from typing import NamedTuple

# Smoothing parameters of the objective, in order: without the first, linear programs stall on kinks
# earlier (0.1 % of the motor's J); with the second, the smoothed J is within 0.02 % of the exact J.
SMOOTHINGS = (0.0006, 0.0001)


class Effort(NamedTuple):
    """The effort of a search for a motion: numbers of starts, steps, rounds and linear programs.

    With the default, the worst-case errors of the motions for the motor of Lu and Yao (2010) are
    about 1 % at most above the best of three longer searches.

    A search from random motions uses all fields up to `smoothings`; a design for the predicted
    error also `searches` and those with `predicted`; an improvement of a given motion uses
    `programs`, `smoothings` and those with `newton`.

    Attributes:
        starts: number of motions that are improved together in the first descent.
        generations: number of generations of motions made of constant speeds, before the first
            descent; with 0 the starts are random.
        stages: number of stages of a descent; each continues with the better half of the motions.
        steps: number of gradient steps per stage.
        rounds: number of rounds in which the best motions are rearranged and descend again.
        variations: number of motions that are improved together in a round. In the same time, four
            rounds of 32 reached lower values than two of 64 or eight of 16.
        parents: number of best motions that are rearranged in a round.
        finalists: number of best motions that are refined by linear programs.
        programs: largest number of linear programs per smoothing in a refinement.
        smoothings: smoothing parameters of the objective in a refinement, in order.
        searches: number of least-squares searches that provide the starts of a design for the
            predicted error. For the motor,
            40 % of them end 0.8 % above the others, so that four fail together in 3 % of cases.
        predicted_programs: largest number of linear programs per smoothing for the predicted error.
        predicted_smoothings: smoothing parameters of the predicted error, in order. The large ones
            allow another order of the phases of a motion, the small ones resolve the threshold of
            δ: for the motor's M, the error ends 0.5 % higher without the first and a third of a per
            cent higher without the last.
        newton_rounds: number of rounds of quasi-Newton steps on a given motion; after each, the
            multipliers of its limits are updated. With 0 only linear programs are solved.
        newton_steps: number of quasi-Newton steps per round.
        newton_smoothing: smoothing parameter of the objective's kinks in quasi-Newton steps.
        newton_penalty: penalty of a squared violation (in half-widths) in quasi-Newton steps,
            relative to the objective.
    """

    starts: int = 64
    generations: int = 100
    stages: int = 3
    steps: int = 240
    rounds: int = 4
    variations: int = 32
    parents: int = 8
    finalists: int = 2
    programs: int = 40
    smoothings: tuple[float, ...] = SMOOTHINGS
    searches: int = 4
    predicted_programs: int = 25
    predicted_smoothings: tuple[float, ...] = (1e-3, 3e-4, 1e-4, 3e-5)
    newton_rounds: int = 8
    newton_steps: int = 40
    newton_smoothing: float = 0.001
    newton_penalty: float = 30.0
