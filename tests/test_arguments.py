"""Arguments that public functions and classes accept or refuse: precision, traced values, lists."""

import inspect

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid as jd
from experiments.axes import linear_motor as motor
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.record import Rows
from jaxid.loop.tube import Tube, parameter_cells
from jaxid.motion.trajectory import uniform
from jaxid.regression.minimax import minimax
from jaxid.regression.worst_case import Norm, infinity

H, T = 1e-3, 0.01  # s: sample period, knot period
BOX = {"position": [0.0, 0.5], "velocity": [-1.0, 1.0], "input": [-9.0, 9.0]}
JERK = [900, -900, -900, 900, 0, -900, 900, 900, -900]


def motion() -> jd.JerkTrajectory:
    return uniform(jnp.zeros(3), jnp.array(JERK, float), T)


def task() -> jd.Task:
    return jd.Task(motor.limits(), motor.boundary(), 9, T)


def plant() -> jd.Plant:
    return jd.Plant(motor.system(), motor.TRUE_PARAMETERS, NoDisturbance())


def experiment():
    return jd.run(plant(), motor.controller(), jd.Servo(H, 1e-6), motion())


def samples():
    time = jnp.arange(90) * H
    return (time, *motion().states(time))


# every public function that takes arrays, with valid arguments
DOORS = {
    "run": lambda: (plant(), motor.controller(), jd.Servo(H, 1e-6), motion()),
    "planned_error": lambda: (motor.system(), motion()),
    "sampled_error": lambda: (motor.system(), *samples()),
    "acceleration_limit": lambda: (motor.system(), *BOX.values()),
    "lower_bound": lambda: (motor.system(), motor.limits()),
    "evaluate": lambda: (
        motor.system(),
        motion(),
        jd.Servo(H, 1e-6),
        jd.lower_bound(motor.system(), motor.limits()),
    ),
    "optimal_motion": lambda: (
        task(),
        jd.LeastSquaresError(motor.system(), "M"),
        jax.random.key(0),
    ),
    "identify": lambda: (motor.system(), [experiment().log]),
    "assumptions": lambda: (motor.system(), experiment().log),
    "filtered_least_squares": lambda: (experiment().record, motor.system(), 200.0, H),
    "sampled": lambda: (motion(), H),
}
# public functions that take only paths, names or numbers
NO_ARRAYS = {
    "configure",
    "read_axis",
    "read_log",
    "write_setpoints",
    "through",
    "position_at_least",
}


def test_every_public_function_is_here():
    functions = {
        name for name in jd.__all__ if inspect.isfunction(inspect.unwrap(getattr(jd, name)))
    }
    functions |= {
        name for name in jd.__all__ if isinstance(getattr(jd, name), type(jd.planned_error))
    }
    assert functions == {*DOORS, *NO_ARRAYS}


def single(tree):
    """Return a tree with its arrays in single precision, and whether any was double before."""
    doubles = [x for x in jax.tree.leaves(tree) if eqx.is_inexact_array(x)]
    return jax.tree.map(
        lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, tree
    ), bool(doubles)


@pytest.mark.parametrize("name", DOORS)
def test_single_precision_is_refused_argument_by_argument(name):
    door, arguments = getattr(jd, name), DOORS[name]()
    some = False
    for k, argument in enumerate(arguments):
        changed, was_double = single(argument)
        if was_double:
            some = True
            with pytest.raises(
                ValueError, match=r"^Argument `\w+` must be float64, but is float32"
            ):
                door(*arguments[:k], changed, *arguments[k + 1 :])
    assert some


@pytest.mark.parametrize("name", DOORS)
def test_a_program_that_forgot_to_switch_on_double_precision_is_told_so(name):
    """Without `jaxid.configure()` all arrays are float32. The error message names `configure()`."""
    with jax.enable_x64(False), pytest.raises(ValueError, match=r"must be float64.*configure\(\)"):
        getattr(jd, name)(*DOORS[name]())


def test_so_are_the_proofs_that_no_top_level_name_leads_to():
    rows, box = experiment().record.rows, motor.system().half_widths
    tube = Tube(
        motor.provable_controller(),
        jd.IdealSensor(),
        parameter_cells(motor.system(), (1,) * 4),
        H,
        90,
    )
    for prove, value in ((tube, motion()), (lambda x: minimax(x, box), rows)):
        with pytest.raises(ValueError, match="must be float64"):
            prove(single(value)[0])


TRACED = {
    "evaluate": "planned_error",
    "lower_bound": "planned_error",
    "identify": "filtered_least_squares",
    "assumptions": "outside",
    "optimal_motion": "criterion",
    "sampled": "JerkTrajectory.states",
}


def numbers_of(tree):
    """Return the arrays of a tree, and a function that puts other arrays in their places."""
    arrays, rest = eqx.partition(tree, eqx.is_array)
    return arrays, lambda others: eqx.combine(others, rest)


@pytest.mark.parametrize("name", DOORS)
def test_each_argument_can_be_traced_or_the_refusal_names_what_can(name, quick_compilation):
    door, arguments = getattr(jd, name), DOORS[name]()
    expected = None if name in TRACED else eqx.filter(door(*arguments), eqx.is_array)
    for k, argument in enumerate(arguments):
        arrays, whole = numbers_of(argument)
        if not jax.tree.leaves(arrays):
            continue

        def traced(arrays, k=k, whole=whole):
            found = door(*arguments[:k], whole(arrays), *arguments[k + 1 :])
            return eqx.filter(found, eqx.is_array)

        if name in TRACED:
            with pytest.raises(ValueError, match=f"traced by `jit`, .*{TRACED[name]}"):
                jax.jit(traced)(arrays)
        elif name == "run" and isinstance(argument, jd.JerkTrajectory):
            with pytest.raises(ValueError, match=r"`durations` is traced .* the jerk alone"):
                jax.jit(traced)(arrays)
        else:
            jax.tree.map(
                lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12),
                jax.tree.leaves(jax.jit(traced)(arrays))[:3],
                jax.tree.leaves(expected)[:3],
            )


def test_what_a_servo_is_made_of_is_not_traced():
    for make in (
        lambda x: jd.Servo(x, 1e-6),
        lambda x: jd.Servo(H, x),
        lambda x: jd.Via(x, [0] * 3, [0] * 3),
    ):
        with pytest.raises(ValueError, match="is traced by `jit`"):
            jax.jit(lambda x, make=make: make(x) and 0)(0.5)


def test_the_slope_of_an_experiment_over_the_jerk(quick_compilation):
    """The gradient of signals, record and log agrees with finite differences.

    With an encoder it is refused.
    """

    def end(jerk, resolution=0.0):
        trajectory, servo = uniform([0, 0, 0], jerk, T), jd.Servo(H, resolution)
        sensor = jd.IdealSensor()
        found = jd.run(plant(), motor.controller(), servo, trajectory, sensor=sensor)
        return found.signals.position[-1] + found.log.position[-1] + found.record.input[5]

    jerk, step = motion().jerk, jnp.zeros(9).at[0].set(1e-2)
    slope, value = jax.jit(jax.grad(end))(jerk), jax.jit(end)
    difference = (value(jerk + step) - value(jerk - step)) / 2e-2
    np.testing.assert_allclose(slope[0], difference, rtol=1e-5)
    with pytest.raises(ValueError, match="a servo of resolution 0"):
        jax.grad(end)(jerk, 1e-6)


SYSTEM = motor.system()
LISTS = {
    "trajectory": lambda kind: jd.JerkTrajectory(kind([0, 0, 0]), kind(JERK), kind([T] * 9)),
    "uniform": lambda kind: uniform(kind([0, 0, 0]), kind(JERK), T),
    "log": lambda kind: jd.Log(kind([1, 2]), kind([0, 1, 3]), H, 0, 0, kind([1, 2])),
    "plant": lambda kind: jd.Plant(SYSTEM, kind([1, 2, 3, 4]), NoDisturbance()),
    "ARC": lambda kind: jd.ARC(SYSTEM, 1, 2, 3, kind([0, 0, 0, 0])),
    "PD": lambda kind: jd.PDFeedforward(SYSTEM, kind([1, 2, 3, 4]), 1, 2),
    "record": lambda kind: jd.Record(
        Rows([kind([1, 2])], kind([3, 4]), kind([1, 1])), kind([0, 1])
    ),
    "norm": lambda kind: Norm(kind([[1, 0], [0, 2]])),
    "infinity": lambda kind: infinity(kind([1.0, np.inf])),
    "via": lambda kind: jd.Via(1.0, kind([0, 0, 0]), kind([1, 0, 0])),
    "through": lambda kind: jd.through(kind([0, 0, 0]), at=1.0),
    "boundary": lambda kind: jd.Boundary(kind([0, 0, 0]), (jd.through(kind([1, 0, 0]), at=1.0),)),
    "limits": lambda kind: jd.Limits(
        **{
            name: kind([-1, 1])
            for name in ("position", "velocity", "acceleration", "jerk", "input")
        }
    ),
    "term": lambda kind: jd.Term("M", "kg", kind([1, 2])),
    "bound": lambda kind: jd.SpeedBand(*kind([1, 2, 3])),
    "targets": lambda kind: jd.PredictedError(SYSTEM, kind([1, 1, 1, 1]), jd.Servo(H)),
    "acceleration limit": lambda kind: jd.acceleration_limit(SYSTEM, *map(kind, BOX.values())),
    "sampled error": lambda kind: jd.sampled_error(SYSTEM, *(kind(x.tolist()) for x in samples())),
}


@pytest.mark.parametrize("name", LISTS)
def test_lists_of_whole_numbers_numpy_and_jax_arrays_are_the_same(name):
    make = LISTS[name]
    expected = make(lambda values: jnp.asarray(values, float))
    for kind in (list, tuple, np.asarray, jnp.asarray):
        found = make(kind)
        assert jax.tree.structure(found) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert jnp.result_type(a) == jnp.result_type(b)
            # the delay, a number of sample periods
            assert jnp.result_type(a) == jnp.float64 or a == 0
            np.testing.assert_array_equal(a, b)


WRONG = {
    "jerk of words": (lambda: jd.JerkTrajectory([0, 0, 0], ["a"], [T]), r"`jerk` must be a number"),
    "a state of two": (lambda: jd.JerkTrajectory([0, 0], [1.0], [T]), r"`start` .* shape \(3,\)"),
    "one duration": (lambda: jd.JerkTrajectory([0] * 3, JERK, [T]), r"`durations` .* shape \(9,\)"),
    "a number for jerk": (lambda: jd.JerkTrajectory([0] * 3, 5.0, T), r"`jerk` .* shape \(1,\)"),
    "a boundary of two": (lambda: jd.Boundary([0, 0], []), r"`start` of a boundary .* \(3,\)"),
    "a via of one": (lambda: jd.Via(1.0, 0.0, 1.0), r"`lower` of a via point .* \(3,\)"),
    "a limit of one number": (
        lambda: jd.Term("M", "kg", 5.0),
        r"`interval` of the term M must be two numbers",
    ),
    "a limit of words": (
        lambda: jd.Term("M", "kg", ["low", "high"]),
        r"`interval` must be a number",
    ),
    "too few parameters": (
        lambda: jd.Plant(SYSTEM, [1.0, 2.0], NoDisturbance()),
        r"`theta` of a plant must have the shape \(4,\) \(for M, B, Fc, dbar\), but has \(2,\)",
    ),
    "one adaptation rate": (lambda: jd.ARC(SYSTEM, 1, 2, 3, 0.0), r"`gamma` of an ARC .* \(4,\)"),
    "feed-forward of three": (
        lambda: jd.PDFeedforward(SYSTEM, [1, 2, 3], 1, 2),
        r"`theta` .* \(4,\)",
    ),
    "ragged": (lambda: Norm([[1, 0], [1]]), r"`functionals` must be a number, an array, or a list"),
    "a vector for a norm": (lambda: Norm([1, 0]), r"`functionals` of a norm must be a matrix"),
    "a table of inputs": (lambda: jd.Log([[1, 2]], [0, 1, 2], H, 0), r"`input` of a log .* \(2,\)"),
    "rows of two lengths": (lambda: Rows([[1, 2]], [1, 2, 3], [1, 1, 1]), r"`columns` of rows"),
    "an input of another": (
        lambda: jd.Record(Rows([[1, 2]], [1, 2], [1, 1]), [1.0]),
        r"`input` of a record",
    ),
    "times that go back": (
        lambda: jd.sampled_error(SYSTEM, [0.0, 2.0, 1.0], *[[0.0, 1.0, 2.0]] * 3),
        r"`time` of a sampled motion must increase",
    ),
    "samples of two lengths": (
        lambda: jd.sampled_error(SYSTEM, [0.0, 1.0], [0.0], [0.0, 1.0], [0.0, 1.0]),
        r"`position` of a sampled motion .* shape \(2,\)",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_meant_is_refused_in_a_sentence(name):
    make, sentence = WRONG[name]
    with pytest.raises(ValueError, match=sentence):
        make()
