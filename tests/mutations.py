"""Mutations of every term of the bounds: the term is halved or left out (see `mutants.py`)."""

from typing import NamedTuple


class Mutation(NamedTuple):
    """One term of a bound made too small.

    Attributes:
        name: unique name, in words.
        file: path below jaxid/.
        source: text that occurs exactly once in the file.
        replacement: text that replaces it.
        tests: pytest names of tests, at least one of which must fail.
    """

    name: str
    file: str
    source: str
    replacement: str
    tests: tuple[str, ...]


BRACKETS, ROWS = "identification/state_bounds.py", "identification/regression_rows.py"
OF_BRACKETS, OF_ROWS = "tests/test_state_bounds.py::", "tests/test_regression_rows.py::"
SHORT_LOGS = (OF_BRACKETS + "test_brackets_of_short_logs_hold_for_the_worst_readings",)
WINDOWS = (
    OF_BRACKETS + "test_velocities_of_windows_hold_for_all_readings_and_accelerations",
    OF_BRACKETS + "test_velocities_of_windows_are_reached",
)
SWEPT = (OF_BRACKETS + "test_what_one_sample_says_of_all_others_is_reached",)
BETWEEN = (OF_BRACKETS + "test_the_velocity_within_a_tick_leaves_its_chord_as_far_as_it_may",)
PLACE = (OF_BRACKETS + "test_the_position_within_a_tick_is_as_far_from_its_ends_as_speed_allows",)
ACCELERATIONS = (OF_BRACKETS + "test_accelerations_are_those_of_the_worst_corner",)
TOP_SPEED = (OF_BRACKETS + "test_no_axis_is_faster_than_the_top_speed",)
READING = (OF_BRACKETS + "test_a_reading_is_off_by_half_a_count_and_what_jitter_adds",)
LATE = (OF_BRACKETS + "test_inputs_that_begin_too_early_or_too_late_are_counted",)
READINGS = (OF_ROWS + "test_wrong_readings_move_a_column_by_what_its_channel_says",)
HIDDEN = (OF_ROWS + "test_brackets_and_delta_count_for_as_much_as_they_can_hide",)
NOT_HELD = (OF_ROWS + "test_inputs_that_are_not_held_as_commanded_are_part_of_delta",)
ANY_WEIGHTS = (OF_ROWS + "test_the_bound_of_any_weights_is_reached_by_the_worst_of_everything",)
PRINTED = ("tests/test_text.py::test_a_printed_bound_is_on_its_side_and_near",)
UPPER_END = (OF_ROWS + "test_the_upper_end_of_any_weights_is_reached_by_the_worst_of_everything",)
INTERPOLATION = ("tests/test_log.py::test_the_error_of_interpolation_is_what_the_worst_motion_has",)

FLOOR, FALSIFICATION = "regression/lower_bound.py", "identification/falsification.py"
ARC, TUBE, OF_TICKS = "loop/controllers.py", "loop/tube.py", "tests/test_tube_ticks.py::"
ACCELERATION, VIOLATION = "motion/acceleration_limit.py", "motion/violation.py"
RANGES, REGRESSORS = "model/interval_arithmetic.py", "model/regressors.py"
DELTA = "model/disturbance_bound.py"
THEOREM_2 = (
    "tests/test_worst_case.py::test_theorem_2_the_adversary_attains_the_bound_and_no_other_sign_does",
)
MINIMAX_REACHED = (
    "tests/test_minimax.py::test_the_worst_case_is_attained_and_no_other_exceeds_it",
)
EXACT = ("tests/test_minimax.py::test_exact_arithmetic_confirms_both_values",)
ESTIMATES = ("tests/test_estimators.py::test_no_truth_is_outside_and_the_worst_one_is_at_the_end",)
FILTERED = (
    "tests/test_estimators.py::test_the_exact_error_of_filtered_data_is_below_that_of_the_paper",
)
PROOF = (
    "tests/test_lower_bound.py::test_its_proof_holds_on_a_dense_random_set_of_states",
    "tests/test_lower_bound.py::test_the_proof_for_combinations_holds_on_such_a_set_too",
)
SCALED = ("tests/test_system.py::test_a_scaled_delta_is_that_multiple_everywhere",)
CONTRADICTION = (
    "tests/test_feasible_parameter_set.py::test_data_that_contradict_delta_are_found_out",
    "tests/test_feasible_parameter_set.py::"
    "test_a_factor_beside_errors_that_it_does_not_multiply_is_no_larger_than_proved",
)
ROBUST = ("tests/test_controllers.py::test_the_robust_term_meets_26_at_every_point_and_no_more",)
PROJECTION = (
    "tests/test_controllers.py::"
    "test_projection_keeps_the_box_and_never_takes_the_estimate_away_from_the_truth",
)
LOOPS = (OF_TICKS + "test_no_loop_by_hand_leaves_the_tube_and_the_worst_ones_fill_it",)
WITHIN = (OF_TICKS + "test_what_changes_within_a_tick_is_counted",)
EXTREMA = ("tests/test_trajectory.py::test_extrema_bound_a_dense_sampling_and_are_attained",)
READINGS_OF_18 = "tests/test_system.py::test_both_readings_of_18"
DEMAND = ("tests/test_local.py::test_demand_is_the_worst_corner",)
BEYOND = tuple(
    f"tests/test_violation.py::test_of_{which}_on_either_side"
    for which in ("each_limit", "via_points", "an_axis")
)
ARITHMETIC = ("tests/test_interval_arithmetic.py::test_arithmetic_is_exact_for_independent_values",)
FORCES = ("tests/test_interval_arithmetic.py::test_ranges_of_regressors_and_bounds",)
OWN = ("tests/test_lower_bound.py::test_ranges_and_magnitude_of_a_users_own_function",)

OF_A_LOG = (
    Mutation(
        "half a count of a reading halved",
        "loop/log.py",
        "self.resolution / 2 + lost",
        "self.resolution / 4 + lost",
        READING,
    ),
    Mutation(
        "half a count of a reading left out",
        "loop/log.py",
        "self.resolution / 2 + lost",
        "lost",
        READING,
    ),
    Mutation(
        "rounding of a reading left out",
        "loop/log.py",
        "self.resolution / 2 + lost",
        "self.resolution / 2",
        ("tests/test_log.py::test_rounding_far_from_zero_is_part_of_the_bound",),
    ),
    Mutation(
        "jitter of a reading halved",
        "loop/log.py",
        "lost + self.jitter * speed",
        "lost + self.jitter / 2 * speed",
        READING,
    ),
    Mutation(
        "jitter of a reading left out",
        "loop/log.py",
        "lost + self.jitter * speed",
        "lost + 0.0 * speed",
        READING,
    ),
    Mutation(
        "jitter of an input halved",
        "loop/log.py",
        "return self.jitter / self.period * steps",
        "return self.jitter / self.period / 2 * steps",
        LATE,
    ),
    Mutation(
        "jitter of the input after a tick left out",
        "loop/log.py",
        "jnp.abs(self.input - before) + jnp.abs(after - self.input)",
        "jnp.abs(self.input - before)",
        LATE,
    ),
    Mutation(
        "the input before a tick left out of those that act",
        "loop/log.py",
        "held | before | after",
        "held | after",
        LATE,
    ),
)

OF_BRACKETS_OF_A_LOG = (
    Mutation(
        "reading error of the mean velocity of a tick halved",
        BRACKETS,
        "reach = (reading[:-1] + reading[1:]) / h + h",
        "reach = (reading[:-1] + reading[1:]) / 2 / h + h",
        SHORT_LOGS,
    ),
    Mutation(
        "acceleration within the tick of a mean velocity left out",
        BRACKETS,
        "/ h + h * abs(acceleration).upper",
        "/ h",
        SHORT_LOGS,
    ),
    Mutation(
        "reading error of the top speed halved",
        BRACKETS,
        "2 * jnp.max(log.reading_error(still)) / h",
        "jnp.max(log.reading_error(still)) / h",
        TOP_SPEED,
    ),
    Mutation(
        "acceleration of the top speed left out",
        BRACKETS,
        "return most + (h + 4 * jitter) * jnp.max(abs(acceleration).upper)",
        "return most + 0.0 * jnp.max(abs(acceleration).upper)",
        TOP_SPEED,
    ),
    Mutation(
        "jitter left out of the top speed",
        BRACKETS,
        "most = most * (h / (h - 2 * jitter))",
        "most = 1.0 * most",
        TOP_SPEED,
    ),
    Mutation(
        "the tick after a reading left out of its jitter",
        BRACKETS,
        "inner = jnp.maximum(speed[:-1], speed[1:])",
        "inner = speed[:-1]",
        (OF_BRACKETS + "test_a_reading_may_lie_in_the_tick_before_or_after",),
    ),
    Mutation(
        "reading error of a position halved",
        BRACKETS,
        "jnp.maximum(reading[:-1], reading[1:]) + far",
        "jnp.maximum(reading[:-1], reading[1:]) / 2 + far",
        PLACE,
    ),
    Mutation(
        "reading error of a position left out",
        BRACKETS,
        "jnp.maximum(reading[:-1], reading[1:]) + far",
        "far",
        PLACE,
    ),
    Mutation(
        "travel within a tick halved",
        BRACKETS,
        "abs(velocity).upper / 2  # from the nearer end",
        "abs(velocity).upper / 4",
        PLACE,
    ),
    Mutation(
        "travel within a tick left out",
        BRACKETS,
        "jnp.maximum(reading[:-1], reading[1:]) + far",
        "jnp.maximum(reading[:-1], reading[1:])",
        PLACE,
    ),
    Mutation(
        "δ of an acceleration halved",
        BRACKETS,
        "(taken + around(delta))",
        "(taken + around(delta / 2))",
        ACCELERATIONS,
    ),
    Mutation(
        "δ of an acceleration left out",
        BRACKETS,
        "(taken + around(delta))",
        "taken",
        ACCELERATIONS,
    ),
    Mutation(
        "δ of an acceleration from its lower end",
        BRACKETS,
        "system.disturbance_bound.range(position, velocity).upper",
        "system.disturbance_bound.range(position, velocity).lower",
        ACCELERATIONS,
    ),
    Mutation(
        "the inertia of an acceleration from its middle",
        BRACKETS,
        "/ inertia",
        "/ inertia.middle",
        ACCELERATIONS,
    ),
    Mutation(
        "the forces of an acceleration with the middle of the box",
        BRACKETS,
        "sum(theta * force for theta",
        "sum(theta.middle * force for theta",
        ACCELERATIONS,
    ),
    Mutation(
        "reading error of the window after a sample halved",
        BRACKETS,
        "(future + reading) / (p * h), -h * after)",
        "(future + reading) / (2 * p * h), -h * after)",
        WINDOWS,
    ),
    Mutation(
        "reading error of the window before a sample halved",
        BRACKETS,
        "(reading + past) / (p * h), h * before)",
        "(reading + past) / (2 * p * h), h * before)",
        WINDOWS,
    ),
    Mutation(
        "reading error of the window around a sample halved",
        BRACKETS,
        "(future + past) / (2 * p * h), gained",
        "(future + past) / (4 * p * h), gained",
        WINDOWS,
    ),
    Mutation(
        "reading error of the sample itself left out of the window after it",
        BRACKETS,
        "(future + reading) / (p * h)",
        "future / (p * h)",
        WINDOWS,
    ),
    Mutation(
        "accelerations after a sample halved",
        BRACKETS,
        "(p * h), -h * after)",
        "(p * h), -h / 2 * after)",
        WINDOWS,
    ),
    Mutation(
        "accelerations before a sample halved",
        BRACKETS,
        "(p * h), h * before)",
        "(p * h), h / 2 * before)",
        WINDOWS,
    ),
    Mutation(
        "accelerations on both sides of a sample halved",
        BRACKETS,
        "gained = h / 2 * before - h / 2 * after",
        "gained = h / 4 * before - h / 4 * after",
        WINDOWS,
    ),
    Mutation(
        "accelerations after a sample left out of the window around it",
        BRACKETS,
        "gained = h / 2 * before - h / 2 * after",
        "gained = h / 2 * before",
        WINDOWS,
    ),
    Mutation(
        "the newest acceleration of a window left out",
        BRACKETS,
        "self.gain + self.total + 0.5 * newest",
        "self.gain + self.total",
        WINDOWS,
    ),
    Mutation(
        "the older accelerations of a window left out",
        BRACKETS,
        "self.gain + self.total + 0.5 * newest",
        "self.gain + 0.5 * newest",
        WINDOWS,
    ),
    Mutation(
        "accelerations from sample to sample halved",
        BRACKETS,
        "jnp.cumsum(x * h)",
        "jnp.cumsum(x * h / 2)",
        SWEPT,
    ),
    Mutation(
        "acceleration between the ends of a tick halved",
        BRACKETS,
        "around(h / 2 * acceleration.half_width)",
        "around(h / 4 * acceleration.half_width)",
        BETWEEN,
    ),
    Mutation(
        "acceleration between the ends of a tick left out",
        BRACKETS,
        "(first | last) + around(h / 2 * acceleration.half_width)",
        "first | last",
        BETWEEN,
    ),
)

OF_ROWS_OF_A_LOG = (
    Mutation(
        "quantised ÿ under hats halved",
        ROWS,
        'channels = {"quantised ÿ": _channel((1.0, -2.0, 1.0), most[0] * half',
        'channels = {"quantised ÿ": _channel((1.0, -2.0, 1.0), most[0] * half / 2',
        READINGS,
    ),
    Mutation(
        "quantised ẏ under hats halved",
        ROWS,
        "most[j] * half / (2 * h), n",
        "most[j] * half / (4 * h), n",
        READINGS,
    ),
    Mutation(
        "quantised ÿ over ticks halved",
        ROWS,
        'most[0] * half / h**2, n),\n        "lag of ẏ"',
        'most[0] * half / 2 / h**2, n),\n        "lag of ẏ"',
        READINGS,
    ),
    Mutation(
        "quantised ẏ over ticks halved",
        ROWS,
        "most[j] * half / h, n",
        "most[j] * half / (2 * h), n",
        READINGS,
    ),
    Mutation(
        "interpolation term h²/12·|ÿ| halved",
        ROWS,
        "most[j] * h / 12 * size_of",
        "most[j] * h / 24 * size_of",
        INTERPOLATION,
    ),
    Mutation(
        "interpolation term h²/12·|ÿ| left out",
        ROWS,
        "most[j] * h / 12 * size_of",
        "0.0 * size_of",
        ("tests/test_log.py::test_without_its_sampling_terms_the_bound_would_be_wrong",),
    ),
    Mutation(
        "lag of ẏ halved",
        ROWS,
        "abs(found.acceleration).upper / 2",
        "abs(found.acceleration).upper / 4",
        INTERPOLATION,
    ),
    Mutation(
        "width of a bracketed regressor halved",
        ROWS,
        "most[j] * x.half_width",
        "most[j] * x.half_width / 2",
        HIDDEN,
    ),
    Mutation(
        "width of a bracketed regressor left out",
        ROWS,
        "(0.0 if j in known else most[j] * x.half_width)",
        "0.0",
        HIDDEN,
    ),
    Mutation(
        "δ of a row from the lower end of its jump over a bracket",
        ROWS,
        "system.disturbance_bound.range(found.position, found.velocity).upper",
        "system.disturbance_bound.range(found.position, found.velocity).lower",
        HIDDEN,
    ),
    Mutation(
        "δ of a row halved",
        ROWS,
        "system.disturbance_bound.range(found.position, found.velocity).upper",
        "system.disturbance_bound.range(found.position, found.velocity).upper / 2",
        HIDDEN,
    ),
    Mutation(
        "jitter of the input of a row left out",
        ROWS,
        "widened + log.input_error()",
        "widened",
        NOT_HELD,
    ),
    Mutation(
        "the largest parameter of a row from one end of the box",
        ROWS,
        "jnp.maximum(jnp.abs(system.lower), jnp.abs(system.upper))",
        "jnp.abs(system.upper)",
        HIDDEN,
    ),
    Mutation(
        "errors that rows share left out of a bound",
        ROWS,
        "(found.bound + logged.shared(counted))",
        "found.bound",
        ANY_WEIGHTS,
    ),
    Mutation(
        "rounding of a bound left out",
        ROWS,
        "(found.bound + logged.shared(counted)) * (1 + ROUNDED)",
        "found.bound + logged.shared(counted)",
        ANY_WEIGHTS,
    ),
    Mutation(
        "errors that rows share halved",
        ROWS,
        "jnp.abs(jnp.stack(spread)) @ self.bound",
        "jnp.abs(jnp.stack(spread)) @ self.bound / 2",
        ANY_WEIGHTS,
    ),
    Mutation(
        "ranges counted as disturbance, so that more of it is told than was there",
        ROWS,
        "jnp.abs(weights) @ logged.delta",
        "disturbed",
        ("tests/test_identify.py::test_the_disturbance_that_is_told_was_there",),
    ),
    Mutation(
        "disturbance of an upper end halved",
        ROWS,
        "error = (disturbed + logged.shared(weights)",
        "error = (disturbed / 2 + logged.shared(weights)",
        UPPER_END,
    ),
    Mutation(
        "disturbance of an upper end left out",
        ROWS,
        "(disturbed + logged.shared(weights) + biased)",
        "(logged.shared(weights) + biased)",
        UPPER_END,
    ),
    Mutation(
        "errors that rows share left out of an upper end",
        ROWS,
        "(disturbed + logged.shared(weights) + biased)",
        "(disturbed + biased)",
        UPPER_END,
    ),
    Mutation(
        "the box in an upper end halved",
        ROWS,
        "(disturbed + logged.shared(weights) + biased)",
        "(disturbed + logged.shared(weights) + biased / 2)",
        UPPER_END,
    ),
    Mutation(
        "the box in an upper end left out",
        ROWS,
        "(disturbed + logged.shared(weights) + biased)",
        "(disturbed + logged.shared(weights))",
        UPPER_END,
    ),
)

OF_ESTIMATORS = (
    Mutation(
        "disturbance term of a worst-case error halved",
        "regression/worst_case.py",
        "return jnp.abs(weights) @ delta",
        "return jnp.abs(weights) @ delta / 2",
        THEOREM_2,
    ),
    Mutation(
        "disturbance term of a biased estimator left out",
        "regression/worst_case.py",
        "return worst_case_error(weights, rows.delta) + worst_case_error(",
        "return worst_case_error(",
        MINIMAX_REACHED,
    ),
    Mutation(
        "bias term of a biased estimator halved",
        "regression/worst_case.py",
        "bias(weights, rows, norm), half_widths\n",
        "bias(weights, rows, norm) / 2, half_widths\n",
        MINIMAX_REACHED,
    ),
    Mutation(
        "disturbance term of an estimate left out",
        "regression/estimate.py",
        "worst_case_error(weights, record.rows.delta)\n        + worst_case_error(remainder",
        "worst_case_error(remainder",
        ESTIMATES,
    ),
    Mutation(
        "bias term of an estimate halved",
        "regression/estimate.py",
        "+ worst_case_error(remainder, system.half_widths)",
        "+ worst_case_error(remainder, system.half_widths) / 2",
        ESTIMATES,
    ),
    Mutation(
        "bias term of an estimate left out",
        "regression/estimate.py",
        "\n        + worst_case_error(remainder, system.half_widths)",
        "",
        ESTIMATES,
    ),
    Mutation(
        "lower end of an interval with half of the bound",
        "regression/estimate.py",
        "self.theta - self.bound",
        "self.theta - self.bound / 2",
        ESTIMATES,
    ),
    Mutation(
        "upper end of an interval with half of the bound",
        "regression/estimate.py",
        "self.theta + self.bound",
        "self.theta + self.bound / 2",
        ESTIMATES,
    ),
    Mutation(
        "δ of J_f halved by the filter",
        "regression/filters.py",
        "return eqx.tree_at(lambda r: r.rows.measure, passed, record.rows.measure)",
        "passed = eqx.tree_at(lambda r: r.rows.delta, passed, passed.rows.delta / 2)\n"
        "    return eqx.tree_at(lambda r: r.rows.measure, passed, record.rows.measure)",
        FILTERED,
    ),
    Mutation(
        "what a filter adds at each tick halved",
        "regression/filters.py",
        "keep * f + (1 - keep) * c",
        "keep * f + (1 - keep) / 2 * c",
        ("tests/test_filters.py::test_low_pass_is_the_held_filter_of_scipy",),
    ),
    Mutation(
        "rounding of a minimax error left out",
        "regression/minimax.py",
        "affine_worst_case_error(weights, *fixed) + _rounding(weights, *fixed)",
        "affine_worst_case_error(weights, *fixed)",
        EXACT,
    ),
    Mutation(
        "rounding of a minimax floor left out",
        "regression/minimax.py",
        "jnp.sum(parts, axis=1) - _relative(parts) * jnp.sum(jnp.abs(parts), axis=1)",
        "jnp.sum(parts, axis=1)",
        EXACT,
    ),
    Mutation(
        "rounding of the rows of a minimax proof left out",
        "regression/minimax.py",
        "(jnp.abs(dot(columns, nu)) + uncertain)",
        "jnp.abs(dot(columns, nu))",
        EXACT,
    ),
    Mutation(
        "the rows in a minimax proof counted half",
        "regression/minimax.py",
        "(jnp.abs(dot(columns, nu)) + uncertain) / delta",
        "(jnp.abs(dot(columns, nu)) + uncertain) / 2 / delta",
        EXACT,
    ),
    Mutation(
        "the box left out of a minimax proof",
        "regression/minimax.py",
        "size = jnp.maximum(size, (1 + rounded) * jnp.max(jnp.abs(nu) / half_widths))",
        "",
        EXACT,
    ),
)

OF_THE_FLOOR = (
    Mutation(
        "the excess over the states left out of the floor",
        FLOOR,
        "value, best = above / excess, nu / excess",
        "value, best = above, nu",
        PROOF,
    ),
    Mutation(
        "the acceleration of a state halved in the floor",
        FLOOR,
        "start=nu[0] * acceleration",
        "start=nu[0] / 2 * acceleration",
        ("tests/test_lower_bound.py::test_the_floor_of_a_mass_is_what_the_smallest_delta_hides",),
    ),
    Mutation(
        "the forces of a state left out of the floor",
        FLOOR,
        "total = sum((n * f for n, f in zip(nu[1:], forces, strict=True)), start=",
        "total = sum((0 * n * f for n, f in zip(nu[1:], forces, strict=True)), start=",
        PROOF,
    ),
    Mutation(
        "δ of a cell of states from its upper end",
        FLOOR,
        "disturbance_bound.range(position, velocity).lower",
        "disturbance_bound.range(position, velocity).upper",
        PROOF,
    ),
    Mutation(
        "rounding of the floor left out",
        FLOOR,
        "return value * (1 - _ROUNDED), above, best",
        "return value, above, best",
        (
            "tests/test_lower_bound.py::"
            "test_where_the_prior_is_better_than_any_experiment_it_is_the_floor",
        ),
    ),
    Mutation(
        "the middle of a cell of states for all of it",
        FLOOR,
        "np.max(look.upper[~undecided], initial=0.0)",
        "np.max(look.middle[~undecided], initial=0.0)",
        PROOF,
    ),
)

OF_FALSIFICATION = (
    Mutation(
        "a factor of δ that explains the data taken for one that does not",
        FALSIFICATION,
        "if found[1] > 1.0:",
        "if found[1] > 0.9:",
        CONTRADICTION,
    ),
    Mutation(
        "a factor of δ that is not proved",
        FALSIFICATION,
        "return low[0], high[0]",
        "return 1.0005 * low[0], high[0]",
        CONTRADICTION,
    ),
    Mutation(
        "a factor above the one whose weights prove it",
        FALSIFICATION,
        "low = min(at * found[1], at), np.nan",
        "low = min(1.1 * at * found[1], at), np.nan",
        CONTRADICTION,
    ),
    Mutation(
        "a proved factor rounded to the nearest",
        "_text.py",
        "Context(digits, ROUND_FLOOR)",
        "Context(digits)",
        PRINTED,
    ),
    Mutation(
        "a printed upper bound rounded to the nearest",
        "_text.py",
        "Context(digits, ROUND_CEILING)",
        "Context(digits)",
        PRINTED,
    ),
    Mutation(
        "the data halved in an upper end of what is possible",
        ROWS,
        "jnp.minimum(weights @ misfit + error, box)",
        "jnp.minimum(weights @ misfit / 2 + error, box)",
        UPPER_END,
    ),
)

OF_CONTROL = (
    Mutation(
        "u_s1 (25) halved",
        ARC,
        "u_s1 = -self.k2 * p",
        "u_s1 = -self.k2 * p / 2",
        ROBUST,
    ),
    Mutation(
        "u_s2 (26) halved",
        ARC,
        "* p / (4 * self.epsilon)  # (26)",
        "* p / (8 * self.epsilon)",
        ROBUST,
    ),
    Mutation(
        "u_s2 (26) left out",
        ARC,
        "return u_a + u_s1 + u_s2, adapted",
        "return u_a + u_s1, adapted",
        ROBUST,
    ),
    Mutation(
        "the regressors in the mismatch halved",
        ARC,
        "return dot([jnp.abs(f) for f in phi], self.reach)",
        "return dot([jnp.abs(f) / 2 for f in phi], self.reach)",
        ROBUST,
    ),
    Mutation(
        "δ left out of the mismatch",
        ARC,
        "self.reach) + self.system.disturbance_bound(y, v)",
        "self.reach)",
        ROBUST,
    ),
    Mutation(
        "the reach of an estimate that moves halved",
        ARC,
        "jnp.where(self.gamma > 0, widths, widths / 2)",
        "widths / 2",
        ROBUST,
    ),
    Mutation(
        "adaptation (22) halved",
        ARC,
        "t - period * self.gamma[j] * f * p",
        "t - period / 2 * self.gamma[j] * f * p",
        PROJECTION,
    ),
    Mutation(
        "projection (23) at the lower end of the box left out",
        ARC,
        "lower[j], upper[j])",
        "-jnp.inf, upper[j])",
        PROJECTION,
    ),
    Mutation(
        "projection (23) at the upper end of the box left out",
        ARC,
        "lower[j], upper[j])",
        "lower[j], jnp.inf)",
        PROJECTION,
    ),
)

OF_THE_TUBE = (
    Mutation(
        "half a count of the encoder halved",
        "loop/sensors.py",
        "SensorError(self.resolution / 2, differenced=True)",
        "SensorError(self.resolution / 4, differenced=True)",
        (OF_TICKS + "test_a_reading_is_within_the_error_of_its_encoder", *LOOPS),
    ),
    Mutation(
        "a count of the encoder rounded down",
        "loop/sensors.py",
        "jnp.round(position / count)",
        "jnp.floor(position / count)",
        (OF_TICKS + "test_a_reading_is_within_the_error_of_its_encoder",),
    ),
    Mutation(
        "the encoder in a velocity that is read halved",
        TUBE,
        "around(2 * cell.jitter)",
        "around(cell.jitter)",
        LOOPS,
    ),
    Mutation(
        "the lag of a velocity that is read halved",
        TUBE,
        "after._replace(lag=-h / 2 * acceleration)",
        "after._replace(lag=-h / 4 * acceleration)",
        LOOPS,
    ),
    Mutation(
        "the lag of a velocity that is read left out",
        TUBE,
        "noise = state.lag + shifted + differenced",
        "noise = shifted + differenced",
        LOOPS,
    ),
    Mutation(
        "the encoder in a position that is fed back left out",
        TUBE,
        "(state.combined + noise + law.k1 * coarse)",
        "(state.combined + noise)",
        LOOPS,
    ),
    Mutation(
        "the encoder in the position of the next tick left out",
        TUBE,
        "read = g + around(k1 * cell.error.position)",
        "read = g",
        LOOPS,
    ),
    Mutation(
        "noise that is left of an encoder from tick to tick halved",
        TUBE,
        "return around(left * cell.jitter)",
        "return around(left * cell.jitter / 2)",
        LOOPS,
    ),
    Mutation(
        "noise of the tick before left out",
        TUBE,
        "left = jnp.abs(fade - keep * shift) + jnp.abs(next_shift - fade)",
        "left = jnp.abs(next_shift - fade)",
        LOOPS,
    ),
    Mutation(
        "noise of the tick itself left out",
        TUBE,
        "left = jnp.abs(fade - keep * shift) + jnp.abs(next_shift - fade)",
        "left = jnp.abs(fade - keep * shift)",
        LOOPS,
    ),
    Mutation(
        "the encoder left out of the velocity at the end of a tick",
        TUBE,
        "after.velocity + around(after.shift * cell.jitter)",
        "after.velocity",
        LOOPS,
    ),
    Mutation(
        "acceleration within a tick in the position error halved",
        TUBE,
        "remainder = h**2 / 2 * acceleration - now.bend",
        "remainder = h**2 / 4 * acceleration - now.bend",
        LOOPS,
    ),
    Mutation(
        "δ of the tube halved",
        TUBE,
        "return around(delta) - _forces",
        "return around(delta / 2) - _forces",
        LOOPS,
    ),
    Mutation(
        "δ of the tube left out",
        TUBE,
        "return around(delta) - _forces",
        "return -_forces",
        LOOPS,
    ),
    Mutation(
        "δ of the tube from the lower end of its jump",
        TUBE,
        "disturbance_bound.range(there, speed).upper",
        "disturbance_bound.range(there, speed).lower",
        WITHIN,
    ),
    Mutation(
        "the change of speed within a tick left out of its forces",
        TUBE,
        "during = speed | (speed + h * wide)",
        "during = speed",
        WITHIN,
    ),
    Mutation(
        "the travel within a tick left out of its forces",
        TUBE,
        "there = place | (place + h * speed)",
        "there = place",
        WITHIN,
    ),
    Mutation(
        "the inertia of the tube from its middle",
        TUBE,
        "return 1 / self.theta[0]",
        "return exactly(1 / self.theta[0].middle)",
        LOOPS,
    ),
    Mutation(
        "the other parameters of the tube from their middle",
        TUBE,
        "sum((t * f for t, f in zip(theta[1:]",
        "sum((t.middle * f for t, f in zip(theta[1:]",
        LOOPS,
    ),
    Mutation(
        "estimates that move taken for the centre of the box",
        TUBE,
        "hat = where(moves, Range(box.lower, box.upper), exactly(box.centre))",
        "hat = where(moves, exactly(box.centre), exactly(box.centre))",
        LOOPS,
    ),
    Mutation(
        "the feedback gain of the tube from its middle",
        TUBE,
        "for end in h))  # h ≥ 0",
        "for end in (h.middle, h.middle)))",
        LOOPS,
    ),
    Mutation(
        "the path of a position between two ticks left out",
        TUBE,
        "_between(place, end_y, during, h)",
        "place | end_y",
        LOOPS,
    ),
    Mutation(
        "rounding of a tick of the tube left out",
        TUBE,
        "spare = around(_ROUNDING * (1 + jnp.abs(now.at.position) / h))",
        "spare = around(0.0)",
        LOOPS,
    ),
    Mutation(
        "rounding of the result of the tube left out",
        TUBE,
        "return found + around(_ROUNDING * (1 + abs(found).upper))",
        "return found",
        LOOPS,
    ),
)

OF_MOTIONS = (
    Mutation(
        "turning points of a position left out",
        "motion/trajectory.py",
        "_span(y, *(s.position for s in inner))",
        "_span(y)",
        EXTREMA,
    ),
    Mutation(
        "turning points of a velocity left out",
        "motion/trajectory.py",
        "_span(v, inner[0].velocity)",
        "_span(v)",
        EXTREMA,
    ),
    Mutation(
        "the second turning point of a position left out",
        "motion/trajectory.py",
        "jnp.where(real & (q != 0), 2 * v",
        "jnp.where(real & (q != 0), 0 * v",
        EXTREMA,
    ),
    Mutation(
        "the forces of (18) halved",
        ACCELERATION,
        "(input + jnp.stack([load, -load]))",
        "(input + jnp.stack([load, -load]) / 2)",
        (READINGS_OF_18,),
    ),
    Mutation(
        "the forces of (18) left out",
        ACCELERATION,
        "(input + jnp.stack([load, -load]))",
        "(input + 0 * jnp.stack([load, -load]))",
        (READINGS_OF_18,),
    ),
    Mutation(
        "the inertia of (18) from the centre of the box",
        ACCELERATION,
        "/ system.upper[0], load",
        "/ system.centre[0], load",
        (READINGS_OF_18,),
    ),
    Mutation(
        "the largest parameters of (18) from one end of the box",
        ACCELERATION,
        "jnp.max(jnp.abs(term.interval))",
        "jnp.abs(term.interval[0])",
        (READINGS_OF_18,),
    ),
    Mutation(
        "the speed of (18) from one end of its limit",
        REGRESSORS,
        "return jnp.max(jnp.abs(velocity))",
        "return jnp.abs(velocity[0])",
        ("tests/test_system.py::test_asymmetric_inputs_give_asymmetric_accelerations",),
    ),
    Mutation(
        "δ left out of the acceleration that an input reaches",
        ACCELERATION,
        "up, down = needs, needs",
        "up, down = 0 * needs, 0 * needs",
        ("tests/test_local.py::test_the_reach_of_the_motor_is_that_of_its_docstring",),
    ),
    Mutation(
        "δ of the input that a motion asks for halved",
        ACCELERATION,
        "start=around(delta)",
        "start=around(delta / 2)",
        DEMAND,
    ),
    Mutation(
        "the box of the input that a motion asks for left out",
        ACCELERATION,
        "(f * theta for f, theta in zip(phi, system.box, strict=True))",
        "(f * theta.middle for f, theta in zip(phi, system.box, strict=True))",
        DEMAND,
    ),
    Mutation(
        "a lower limit left out of a violation",
        VIOLATION,
        "jnp.maximum(values - interval[1], interval[0] - values)",
        "(values - interval[1])",
        BEYOND,
    ),
    Mutation(
        "a violation halved",
        VIOLATION,
        "half_width = (interval[1] - interval[0]) / 2",
        "half_width = interval[1] - interval[0]",
        BEYOND,
    ),
    Mutation(
        "via points left out of a violation",
        VIOLATION,
        "jnp.concatenate([*sides, _via_excess(limits, boundary, trajectory)])",
        "jnp.concatenate(sides)",
        BEYOND,
    ),
    Mutation(
        "the lower end of an axis left out of a violation",
        VIOLATION,
        "jnp.maximum(_beyond(values.lower, interval), _beyond(values.upper, interval))",
        "_beyond(values.upper, interval)",
        BEYOND,
    ),
)

OF_RANGES = (
    Mutation(
        "one end of a product left out",
        RANGES,
        "return other * self.lower | other * self.upper",
        "return other * self.upper",
        ARITHMETIC,
    ),
    Mutation(
        "one end of a quotient left out",
        RANGES,
        "quotient = exactly(other / self.lower) | other / self.upper",
        "quotient = exactly(other / self.lower)",
        ARITHMETIC,
    ),
    Mutation(
        "a divisor that may be zero taken for another",
        RANGES,
        "return where(_holds_zero(self), around(jnp.inf), quotient)",
        "return quotient",
        (
            "tests/test_interval_arithmetic.py::"
            "test_a_quotient_is_unbounded_if_the_divisor_may_be_zero",
        ),
    ),
    Mutation(
        "the ends of a difference taken from the same side",
        RANGES,
        "return Range(self.lower - upper, self.upper - lower)",
        "return Range(self.lower - lower, self.upper - upper)",
        ARITHMETIC,
    ),
    Mutation(
        "the crest of a sine left out",
        REGRESSORS,
        "jnp.where(crest, 1.0, ends.upper)",
        "ends.upper",
        FORCES,
    ),
    Mutation(
        "the trough of a sine left out",
        REGRESSORS,
        "jnp.where(trough, -1.0, ends.lower)",
        "ends.lower",
        FORCES,
    ),
    Mutation(
        "the slope over position of a user's own regressor halved",
        REGRESSORS,
        "slopes[0] * position.half_width",
        "slopes[0] / 2 * position.half_width",
        OWN,
    ),
    Mutation(
        "the slope over velocity of a user's own regressor left out",
        REGRESSORS,
        " + slopes[1] * velocity.half_width",
        "",
        OWN,
    ),
    Mutation(
        "rest left out of a friction in one direction",
        REGRESSORS,
        "where(always, moving, moving | 0.0)",
        "moving",
        FORCES,
    ),
    Mutation(
        "dry friction at rest taken for that of a motion forward",
        REGRESSORS,
        "Range(jnp.where(lower > 0, 1.0, -1.0)",
        "Range(jnp.where(lower >= 0, 1.0, -1.0)",
        ("tests/test_interval_arithmetic.py::test_dry_friction_may_be_anything_at_rest",),
    ),
    Mutation(
        "the slow side of δ left out of its jump",
        DELTA,
        "return exactly(slowest) | fastest",
        "return exactly(fastest)",
        FORCES,
    ),
    Mutation(
        "a factor of δ left out of its range",
        DELTA,
        "return self.factor * self.bound.range(position, velocity)",
        "return self.bound.range(position, velocity)",
        SCALED,
    ),
    Mutation(
        "a multiple of a multiple of δ with one of its factors",
        DELTA,
        "return ScaledBound(self.bound, factor * self.factor)",
        "return ScaledBound(self.bound, factor)",
        SCALED,
    ),
    Mutation(
        "a multiple of a step of δ with its fast level unchanged",
        DELTA,
        "return SpeedBand(factor * self.slow, factor * self.fast, self.threshold, self.blend)",
        "return SpeedBand(factor * self.slow, self.fast, self.threshold, self.blend)",
        SCALED,
    ),
    Mutation(
        "the reach of a cautious δ halved",
        DELTA,
        "velocity + around(self.reach)",
        "velocity + around(self.reach / 2)",
        ("tests/test_system.py::test_a_cautious_bound_is_the_largest_within_reach",),
    ),
)

OF_CLOCKS = (
    Mutation(
        "jitter of the stamps of a log halved",
        "io/segments.py",
        "float(np.ptp(rest) / 2)",
        "float(np.ptp(rest) / 4)",
        ("tests/test_segments.py::test_every_piece_is_steady",),
    ),
    Mutation(
        "what coarse stamps may hide left out",
        "io/segments.py",
        "return period, missed + spacing / 2",
        "return period, missed",
        ("tests/test_segments.py::test_what_coarse_stamps_may_hide_counts_as_jitter",),
    ),
)

MUTATIONS = (
    *OF_A_LOG, *OF_BRACKETS_OF_A_LOG, *OF_ROWS_OF_A_LOG, *OF_ESTIMATORS, *OF_THE_FLOOR,
    *OF_FALSIFICATION, *OF_CONTROL, *OF_THE_TUBE, *OF_MOTIONS, *OF_RANGES, *OF_CLOCKS,
)  # fmt: skip
