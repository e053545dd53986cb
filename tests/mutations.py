"""The terms of all bounds, and what each is replaced by: halved, or left out; see `mutants.py`."""

from typing import NamedTuple


class Mutation(NamedTuple):
    """One term of a bound made too small.

    Attributes:
        name: in words, of no other one.
        file: under jaxid/.
        source: a text that occurs there once.
        replacement: for it.
        tests: by their names for pytest; one at least must fail.
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
UPPER_END = (OF_ROWS + "test_the_upper_end_of_any_weights_is_reached_by_the_worst_of_everything",)
INTERPOLATION = ("tests/test_log.py::test_the_error_of_interpolation_is_what_the_worst_motion_has",)

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
        "gain + total + 0.5 * newest",
        "gain + total",
        WINDOWS,
    ),
    Mutation(
        "the older accelerations of a window left out",
        BRACKETS,
        "gain + total + 0.5 * newest",
        "gain + 0.5 * newest",
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
        "delta + log.misheld()",
        "delta",
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
        "errors that rows share halved",
        ROWS,
        "jnp.abs(jnp.stack(spread)) @ self.bound",
        "jnp.abs(jnp.stack(spread)) @ self.bound / 2",
        ANY_WEIGHTS,
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

MUTATIONS = OF_A_LOG + OF_BRACKETS_OF_A_LOG + OF_ROWS_OF_A_LOG
