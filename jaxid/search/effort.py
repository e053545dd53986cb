"""How long a search goes on, for every kind of search."""

from typing import NamedTuple

# Of the objective, one after the other: without the first the programs stall on kinks earlier
# (0.1 % of the motor's J), and after the second the rounded J is within 0.02 % of the exact one.
SMOOTHINGS = (0.0006, 0.0001)


class Effort(NamedTuple):
    """How long to search for a motion. The default finds the motor's motions within one per cent.

    A search from random motions takes all fields up to `smoothings`, a design for the predicted
    error those with `searches` and `predicted` as well; an improvement of a given motion takes
    `programs`, `smoothings` and those with `newton`.

    Attributes:
        starts: motions that are improved together, at the beginning.
        generations: of motions made of phases of constant speed, before the first descent; with 0
            the starts are random.
        stages: of a descent; each goes on with the better half.
        steps: of gradient descent per stage.
        rounds: of rearranging the best and descending again.
        variations: motions that are improved together in a round. In the same time four rounds of
            32 reached further than two of 64 or eight of 16.
        parents: how many of the best are rearranged.
        finalists: how many of the best are refined by linear programs.
        programs: linear programs per smoothing, at most, in a refinement.
        smoothings: of the objective in a refinement, one after the other.
        searches: for starts of a design for the predicted error. In 40 % of those for the motor the
            order of its phases ends 0.8 % above the others, so that four fail together in 3 %.
        predicted_programs: linear programs per smoothing, at most, for the predicted error.
        predicted_smoothings: of the predicted error. The large ones move a motion into another
            order of its phases, the small ones see what an instant at the threshold of δ is worth:
            without the first the motor's M ends half a per cent higher, without the last a third.
        newton_rounds: of quasi-Newton steps on a given motion; after each the multipliers of its
            limits are updated. With 0 only linear programs are solved.
        newton_steps: quasi-Newton steps per round.
        newton_smoothing: of the objective's kinks in these steps.
        newton_penalty: of a squared violation, in half-widths, against the objective.
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
