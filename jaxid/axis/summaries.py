"""The structures of the files that the command writes for other programs: every key, with its unit.

The JSON files and the table of a trade-off are made from these structures, key by key and in this
order. A number that is not finite is null. "The unit" of a parameter is that of its key `unit`.
"""

import msgspec

Number = float | None  # null where it is not finite
Ends = tuple[float, float]


class DesignedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """The evaluation of a designed motion for one parameter.

    Attributes:
        unit: unit of the parameter.
        interval: prior interval of the parameter, lower and upper end, in the unit.
        J: worst-case error of least squares of exact signals (16), in the unit.
        guaranteed: predicted guaranteed error in the unit: that of an undisturbed axis at the
            centre of its prior box.
        floor: proved lower bound on the error of any motion within the limits and any estimator, in
            the unit.
        gap: relative optimality gap guaranteed / floor − 1.
        guaranteed_with_delta_times: predicted guaranteed error in the unit if δ were multiplied by
            a factor, by the factor.
        wanted: error that the axis file requires, in the unit; the key is absent if it requires
            none.
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
    """The content of `design.json`: a designed motion, its evaluation and its assumptions.

    Attributes:
        program: name and version of the program that wrote it.
        axis_sha256: SHA-256 of the axis file, and of the Python module that it names.
        target: name of the parameter that the motion is for; all; or wanted.
        search: seed and effort of the search, in words.
        begins_s: time in the set-points at which the motion begins, after the approach, s.
        ends_s: time in the set-points at which the motion ends, s.
        parameters: evaluation of the motion, by the name of the parameter.
        margins: smallest margin of the exported positions to each limit, in half-widths of the
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
    """One row of `tradeoff.csv`: the evaluation of one motion for one parameter.

    Attributes:
        target: name of the parameter that the motion is for; all; or wanted.
        duration_s: duration of the motion without its approach, s.
        parameter: name of the parameter.
        unit: unit of the parameter.
        J: worst-case error of least squares of exact signals (16), in the unit.
        guaranteed: predicted guaranteed error, in the unit.
        floor: proved lower bound on the error of any motion and any estimator, in the unit.
        gap: relative optimality gap guaranteed / floor − 1.
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
    """The violation of one limit by simulated random axes.

    Attributes:
        beyond: number of axes that exceeded the limit.
        least_margin: smallest margin of all axes to the limit, in half-widths of the limit; below
            zero the limit was exceeded, null if a loop diverged.
    """

    beyond: int
    least_margin: Number


class HalfLength(msgspec.Struct, frozen=True, kw_only=True):
    """The half-widths of the guaranteed intervals of one parameter from simulated logs.

    Attributes:
        unit: unit of the parameter.
        median: median over all logs, in the unit.
        most: largest over all logs, in the unit.
    """

    unit: str
    median: Number
    most: Number


class SimulationSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The content of `simulation.json`: a Monte Carlo simulation of random axes along a motion.

    It is evidence, not a proof.

    Attributes:
        program: name and version of the program that wrote it.
        axis_sha256: SHA-256 of the axis file, and of the Python module that it names.
        seed: seed of the random axes and disturbances.
        plants: number of simulated axes.
        limits: violations of each limit: position, velocity, input, input_rate.
        logs: number of axes whose logs were also identified.
        logs_with_a_truth_outside: number of these logs with a true parameter outside its interval.
        half_length: half-widths of the intervals from the logs, by the name of the parameter.
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
    """The result of an identification for one parameter.

    The last four keys are absent if the log is inconsistent with the axis.

    Attributes:
        unit: unit of the parameter.
        prior: prior interval in the axis file, lower and upper end, in the unit.
        least_squares: least-squares estimate, in the unit; null if the log does not identify the
            parameters separately.
        theta_hat: centre estimate of a fixed linear estimator, in the unit.
        bound: worst-case error of theta_hat, in the unit.
        guaranteed: intersection of theta_hat ± bound with the prior interval, in the unit; it
            contains the true value.
        possible: guaranteed interval that contains all values consistent with the log, in the unit;
            it lies within guaranteed.
    """

    unit: str
    prior: Ends
    least_squares: Number
    theta_hat: float | msgspec.UnsetType = msgspec.UNSET
    bound: float | msgspec.UnsetType = msgspec.UNSET
    guaranteed: Ends | msgspec.UnsetType = msgspec.UNSET
    possible: Ends | msgspec.UnsetType = msgspec.UNSET


class UsedPiece(msgspec.Struct, frozen=True, kw_only=True):
    """A segment of consecutive rows of a log that were used together.

    Attributes:
        first_row: first row of the segment, from 1.
        last_row: last row of the segment.
        period_s: sample period of its rows, s.
        jitter_s: largest deviation of a sample from a multiple of the period, s.
    """

    first_row: int
    last_row: int
    period_s: float
    jitter_s: float


class IdentificationSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The content of `result.json`: guaranteed intervals from a log, or its inconsistency.

    Attributes:
        program: name and version of the program that wrote it.
        consistent: whether the log is not proved to be inconsistent with the axis.
        contradiction: inconsistency of the log, in a sentence; null if it is consistent.
        least_factor_of_disturbance_bound: proved lower bound on the factor of δ that the log needs;
            null if there is none.
        parameters: result of each parameter, by its name.
        not_told_apart: parameters that are not identifiable, each with a direction of parameters
            that changes nothing in the log, in their units.
        rows: number of rows of the log.
        rows_used: number of rows that were used.
        stretches: number of batches in which the log was processed; null for an inconsistent log.
        ticks_to_a_weight: largest mean number of samples per estimator weight; null for an
            inconsistent log.
        pieces: segments between gaps, repeated rows and missing numbers.
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
