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
        prior: prior interval of the parameter, lower and upper end, in the unit.
        least_squares: worst-case error of least squares of exact signals (16), in the unit.
        predicted: predicted guaranteed half-width in the unit: that from the log of an undisturbed
            axis at the centre of its prior box.
        lower_bound: proved lower bound on the half-width that any motion within the limits and any
            estimator can promise before the data are known, in the unit.
        gap: relative optimality gap predicted / lower_bound − 1.
        predicted_with_delta_times: predicted guaranteed half-width in the unit if δ were multiplied
            by a factor, by the factor.
        wanted: error that the axis file requires, in the unit; the key is absent if it requires
            none.
    """

    unit: str
    prior: Ends
    least_squares: Number
    predicted: Number
    lower_bound: Number
    gap: Number
    predicted_with_delta_times: dict[str, Number]
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
        assumptions: assumptions, in sentences.
    """

    program: str
    axis_sha256: str
    target: str
    search: str
    begins_s: float
    ends_s: float
    parameters: dict[str, DesignedParameter]
    margins: dict[str, float]
    assumptions: tuple[str, ...]


class TradeoffRow(msgspec.Struct, frozen=True, kw_only=True):
    """One row of `tradeoff.csv`: the evaluation of one motion for one parameter.

    Attributes:
        target: name of the parameter that the motion is for; all; or wanted.
        duration_s: duration of the motion without its approach, s.
        parameter: name of the parameter.
        unit: unit of the parameter.
        least_squares: worst-case error of least squares of exact signals (16), in the unit.
        predicted: predicted guaranteed half-width, in the unit.
        lower_bound: proved lower bound on the half-width that any motion within the limits and any
            estimator can promise before the data are known, in the unit.
        gap: relative optimality gap predicted / lower_bound − 1.
    """

    target: str
    duration_s: float
    parameter: str
    unit: str
    least_squares: float
    predicted: float
    lower_bound: float
    gap: float


class SimulatedLimit(msgspec.Struct, frozen=True, kw_only=True):
    """The violation of one limit by simulated random plants.

    Attributes:
        unit: unit of the limit.
        exceeded_by: number of plants that exceeded the limit.
        smallest_margin: smallest margin of all plants to the limit, in the unit; below zero the
            limit was exceeded, null if a loop diverged.
    """

    unit: str
    exceeded_by: int
    smallest_margin: Number


class SimulatedHalfWidth(msgspec.Struct, frozen=True, kw_only=True):
    """The half-widths of the intervals θ̂ ± bound of one parameter from simulated logs.

    They lie in the prior box. An identification of the same log guarantees no wider interval.

    Attributes:
        unit: unit of the parameter.
        median: median over all logs, in the unit.
        largest: largest over all logs, in the unit.
    """

    unit: str
    median: Number
    largest: Number


class SimulationSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The content of `simulation.json`: a Monte Carlo simulation of random plants along a motion.

    It is evidence, not a proof.

    Attributes:
        program: name and version of the program that wrote it.
        axis_sha256: SHA-256 of the axis file, and of the Python module that it names.
        seed: seed of the random plants and disturbances.
        plants: number of simulated plants.
        limits: violations of each limit: position, velocity, input, input_rate.
        logs: number of simulated logs that were also identified.
        logs_missing_the_truth: number of these logs with a true parameter outside its interval.
        half_widths: half-widths of the intervals from the logs, by the name of the parameter.
        log_theta: true parameters of the plant of `simulated_log.csv`, in their units.
        assumptions: assumptions, in sentences.
    """

    program: str
    axis_sha256: str
    seed: int
    plants: int
    limits: dict[str, SimulatedLimit]
    logs: int
    logs_missing_the_truth: int
    half_widths: dict[str, SimulatedHalfWidth]
    log_theta: dict[str, float]
    assumptions: tuple[str, ...]


class IdentifiedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """The result of an identification for one parameter.

    The last three keys are absent if the log is inconsistent with the axis.

    Attributes:
        unit: unit of the parameter.
        prior: prior interval in the axis file, lower and upper end, in the unit.
        least_squares_estimate: estimate of an ordinary least-squares fit, without any guarantee, in
            the unit; null if the log does not identify the parameters separately.
        guaranteed: interval that contains the true value if the assumptions hold, in the unit: all
            values that are consistent with the log.
        theta_hat: estimate by the best fixed weights, in the unit.
        bound: worst-case error of theta_hat, in the unit; theta_hat ± bound contains the guaranteed
            interval.
    """

    unit: str
    prior: Ends
    least_squares_estimate: Number
    guaranteed: Ends | msgspec.UnsetType = msgspec.UNSET
    theta_hat: float | msgspec.UnsetType = msgspec.UNSET
    bound: float | msgspec.UnsetType = msgspec.UNSET


class UsedSegment(msgspec.Struct, frozen=True, kw_only=True):
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
        inconsistency: inconsistency of the log, in a sentence; null if it is consistent.
        disturbance_factor: proved lower bound on the factor of δ that the log needs; null if there
            is none.
        parameters: result of each parameter, by its name.
        not_identifiable: parameters that are not identifiable, each with a direction of parameters
            that changes nothing in the log, in their units.
        rows: number of rows of the log.
        rows_used: number of rows that were used.
        batches: number of batches in which the log was processed; null for an inconsistent log.
        interrupted: whether the user interrupted the command, so that other rows were not tested.
        samples_per_weight: largest mean number of samples per estimator weight; null for an
            inconsistent log.
        segments: segments between gaps, repeated rows and missing numbers.
        assumptions: assumptions, in sentences.
    """

    program: str
    consistent: bool
    inconsistency: str | None
    disturbance_factor: Number
    parameters: dict[str, IdentifiedParameter]
    not_identifiable: dict[str, dict[str, float]]
    rows: int
    rows_used: int
    batches: int | None
    interrupted: bool
    samples_per_weight: Number
    segments: tuple[UsedSegment, ...]
    assumptions: tuple[str, ...]
