"""What the files of the command say to other programs: every key, with its unit.

The JSON files and the table of a trade-off are made from these structures, key by key and in this
order. A number that is not finite is null. "The unit" of a parameter is that of its key `unit`.
"""

import msgspec

Number = float | None  # null where it is not finite
Ends = tuple[float, float]


class DesignedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """What a designed motion is worth for one parameter.

    Attributes:
        unit: of the parameter.
        interval: its prior interval, lower and upper end, in the unit.
        J: error of least squares of exact signals, (16), in the unit.
        guaranteed: error that the log can be expected to guarantee, in the unit: that of an
            undisturbed axis in the middle of its box.
        floor: what no motion within the limits and no estimator can promise to go below, in the
            unit.
        gap: guaranteed / floor − 1.
        guaranteed_with_delta_times: the same as guaranteed, if δ were so many times as large; by
            the factor.
        wanted: error that the axis file wants, in the unit; no key where it wants none.
    """

    unit: str
    interval: Ends
    J: Number
    guaranteed: Number
    floor: Number
    gap: Number
    guaranteed_with_delta_times: dict[str, Number]
    wanted: float | msgspec.UnsetType = msgspec.UNSET


class DesignSummary(msgspec.Struct, frozen=True, kw_only=True):
    """`design.json`: a designed motion, what it is worth, and what that rests on.

    Attributes:
        program: name and version of what wrote it.
        axis_sha256: of the axis file, and of the Python module that it names.
        target: the parameter that the motion is for; all; or wanted.
        search: seed and effort of the search, in words.
        begins_s: when the motion begins in the set-points, s: the approach is before it.
        ends_s: when it ends, s.
        parameters: what it is worth, by the name of the parameter.
        margins: what the exported positions leave of each limit at least, in half-widths of the
            limit; velocity and acceleration are those of straight lines between the positions.
        rests_on: assumptions, in sentences.
    """

    program: str
    axis_sha256: str
    target: str
    search: str
    begins_s: float
    ends_s: float
    parameters: dict[str, DesignedParameter]
    margins: dict[str, float]
    rests_on: tuple[str, ...]


class TradeoffRow(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `tradeoff.csv`: one motion and one parameter.

    Attributes:
        target: the parameter that the motion is for; all; or wanted.
        duration_s: of the motion without its approach, s.
        parameter: its name.
        unit: of the parameter.
        J: as in `design.json`, in the unit.
        guaranteed: as there, in the unit.
        floor: as there, in the unit.
        gap: guaranteed / floor − 1.
    """

    target: str
    duration_s: float
    parameter: str
    unit: str
    J: float
    guaranteed: float
    floor: float
    gap: float


class SimulatedLimit(msgspec.Struct, frozen=True, kw_only=True):
    """How random axes kept one limit.

    Attributes:
        beyond: how many of the axes left it.
        least_margin: what the worst of them left of it, in half-widths of the limit; below zero it
            went beyond it, null if its loop diverged.
    """

    beyond: int
    least_margin: Number


class HalfLength(msgspec.Struct, frozen=True, kw_only=True):
    """Half of the interval that a simulated log proves for one parameter.

    Attributes:
        unit: of the parameter.
        median: of all logs, in the unit.
        most: of all logs, in the unit.
    """

    unit: str
    median: Number
    most: Number


class SimulationSummary(msgspec.Struct, frozen=True, kw_only=True):
    """`simulation.json`: what random axes of the box did along a motion. Evidence, no proof.

    Attributes:
        program: name and version of what wrote it.
        axis_sha256: of the axis file, and of the Python module that it names.
        seed: of the axes and of what disturbs them.
        plants: how many axes there were.
        limits: how they kept each limit: position, velocity, input, input_rate.
        logs: of how many axes it was found what their logs prove.
        logs_with_a_truth_outside: of how many of these a true parameter is outside of its interval.
        half_length: of the intervals that the logs prove, by the name of the parameter.
        rests_on: assumptions, in sentences.
    """

    program: str
    axis_sha256: str
    seed: int
    plants: int
    limits: dict[str, SimulatedLimit]
    logs: int
    logs_with_a_truth_outside: int
    half_length: dict[str, HalfLength]
    rests_on: tuple[str, ...]


class IdentifiedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """What a log proves of one parameter; the last four keys are absent if it contradicts the axis.

    Attributes:
        unit: of the parameter.
        prior: its interval in the axis file, lower and upper end, in the unit.
        least_squares: estimate by least squares, in the unit; null if the log does not tell the
            parameters apart.
        theta_hat: the estimate that the guaranteed interval is around, in the unit.
        bound: how far the truth is from theta_hat at most, in the unit.
        guaranteed: interval that holds the truth, in the unit.
        possible: interval of all values that no stretch of the log excludes, in the unit; within
            guaranteed.
    """

    unit: str
    prior: Ends
    least_squares: Number
    theta_hat: float | msgspec.UnsetType = msgspec.UNSET
    bound: float | msgspec.UnsetType = msgspec.UNSET
    guaranteed: Ends | msgspec.UnsetType = msgspec.UNSET
    possible: Ends | msgspec.UnsetType = msgspec.UNSET


class UsedPiece(msgspec.Struct, frozen=True, kw_only=True):
    """Rows of a log that were used together.

    Attributes:
        first_row: of the piece, from 1.
        last_row: of the piece.
        period_s: of its rows, s.
        jitter_s: how far an instant is from a multiple of the period at most, s.
    """

    first_row: int
    last_row: int
    period_s: float
    jitter_s: float


class IdentificationSummary(msgspec.Struct, frozen=True, kw_only=True):
    """`result.json`: intervals that a log proves, or in what it contradicts the axis.

    Attributes:
        program: name and version of what wrote it.
        consistent: whether the log may be one of the axis.
        contradiction: why not, in a sentence; null if it may.
        least_factor_of_disturbance_bound: how many times δ it takes at least to explain the log;
            null where that says nothing.
        parameters: what is proved, by the name of the parameter.
        not_told_apart: parameters whose interval may stay as it is whatever the data, each with
            how much of which parameters it can be exchanged for, in their units.
        rows: of the log.
        rows_used: how many of them were used.
        stretches: how many batches the log was processed in; null for an inconsistent log.
        ticks_to_a_weight: how many servo periods share a weight of the estimate; null likewise.
        pieces: between gaps, repeated rows and missing numbers.
        rests_on: assumptions, in sentences.
    """

    program: str
    consistent: bool
    contradiction: str | None
    least_factor_of_disturbance_bound: Number
    parameters: dict[str, IdentifiedParameter]
    not_told_apart: dict[str, dict[str, float]]
    rows: int
    rows_used: int
    stretches: int | None
    ticks_to_a_weight: Number
    pieces: tuple[UsedPiece, ...]
    rests_on: tuple[str, ...]
