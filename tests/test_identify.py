"""`identify` with batches of any size: coverage, and refusal of inconsistent logs."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxid as jd
from experiments.axes import linear_motor as motor
from jaxid.identification import identify as door
from jaxid.identification.batches import BatchSizes, batches, most_informative, samples_per_weight
from jaxid.identification.falsification import LEAST, MOST
from jaxid.identification.identify import InterruptedIdentification, identify
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import NoDisturbance, Sequence
from jaxid.loop.log import InconsistentLogError, Log, filled
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.motion.trajectory import uniform

TRUTH = np.array(motor.TRUE_PARAMETERS)
PERIOD = motor.CONTROL_PERIOD


@pytest.fixture(scope="module")
def parts(figures):
    """Return four logs of 749 samples each, cut from one log of the motor."""
    motion = read_trajectory(figures / "trajectory_minimax.csv")
    whole = run(motor.plant(), motor.controller(), motor.servo(), motion).log
    return [cut(whole, first, 749) for first in range(0, 2996, 749)]


def cut(log, first, ticks):
    input, position = log.input[first : first + ticks], log.position[first : first + ticks + 1]
    return Log(input, position, log.period, log.resolution)


# smaller batches and fewer weights than the defaults
SMALL = BatchSizes(samples=1500, knots=300, knots_together=900)


def proved(system, logs, sizes=SMALL):
    """Return the intervals and None, or None and the inconsistency."""
    try:
        return identify(system, logs, sizes=sizes), None
    except InconsistentLogError as error:
        return None, error


def slide():
    """Return the example of the README."""
    return jd.System(
        terms=(
            jd.Term("m", "kg", (5.0, 9.0)),
            jd.Term("b", "N s/m", (0.0, 40.0), jd.Viscous()),
            jd.Term("Fc", "N", (0.0, 30.0), jd.Coulomb(beta=500.0)),
        ),
        disturbance_bound=jd.ConstantBound(6.0),
        input_unit="N",
    )


def slide_log(theta=(7.0, 20.0, 15.0)):
    """Return 1,200 samples of a motion there and back; Δ is ±3 N and changes sign four times."""
    jerk = jnp.array([20.0, -20.0, 0.0, -20.0, 20.0, -20.0, 20.0, 0.0, 20.0, -20.0, 0.0, 0.0])
    motion = uniform(jnp.array([0.1, 0.0, 0.0]), jerk, 0.1)
    n, h = 1200, 0.001
    states = motion.states((jnp.arange(n) + 0.5) * h)
    push = sum(f * t for f, t in zip(slide().regressors(*states), theta, strict=True))
    unknown = 3.0 * jnp.sign(jnp.sin(2 * jnp.pi * jnp.arange(n) / 480))
    position = motion.states(jnp.arange(n + 1) * h).position
    return Log(push + unknown, jnp.round(position / 1e-6) * 1e-6, h, 1e-6)


@pytest.mark.parametrize("factor", [0.3, 0.2, 0.1])
def test_data_that_contradict_the_bound_are_refused(factor):
    """The log gives intervals with its δ, and is refused with a δ below the proved minimum."""
    system, log = slide(), slide_log()
    found = jd.identify(system, log)
    for theta, low, high in zip((7.0, 20.0, 15.0), found.lower, found.upper, strict=True):
        assert low <= theta <= high
    assert 0.3 < found.disturbance_factor <= 0.5
    with pytest.raises(jd.InconsistentLogError, match="unless the disturbance bound is") as refused:
        jd.identify(system.with_scaled_disturbance(factor), log)
    # both report the same smallest δ
    assert refused.value.factor == pytest.approx(found.disturbance_factor / factor, rel=2e-3)
    assert refused.value.factor > 1


@pytest.mark.parametrize("scale", [0.55, 0.3, 0.05])
def test_a_refusal_by_the_narrowed_box_has_a_number(monkeypatch, scale):
    """The test of δ is disabled here, and the narrowed box refuses the log.

    The reported factor of δ is a proved lower bound on the simulated disturbance.
    """
    log = random_slide_log(0, 0.6, substeps=20)
    system = slide().with_scaled_disturbance(scale)
    monkeypatch.setattr(door, "smallest_disturbance_factor", lambda *arguments: LEAST)
    with pytest.raises(InconsistentLogError, match="unless the disturbance bound is") as refused:
        identify(system, log)
    assert "logged" not in str(refused.value)
    assert 0.9 * 0.6 < refused.value.factor * scale <= 0.6


def test_logs_are_processed_as_many_together_as_are_a_batch(parts):
    assert [len(part) for part in batches(parts, SMALL)] == [2, 2]
    assert [log for part in batches(parts, SMALL) for log in part] == parts
    assert [len(part) for part in batches([*parts, cut(parts[0], 0, 3)], SMALL)] == [2, 2, 1]
    many = [cut(parts[0], k, 4) for k in range(250)]
    assert [len(part) for part in batches(many, SMALL)] == [100, 100, 50]


def test_a_long_log_is_cut_into_equal_parts_that_lose_nothing(parts):
    log = parts[0]
    (one,), (other,) = batches([log], SMALL._replace(samples=400))
    assert (one.input.size, other.input.size) == (374, 375)
    np.testing.assert_array_equal(jnp.concatenate([one.input, other.input]), log.input)
    np.testing.assert_array_equal(one.position, log.position[:375])
    np.testing.assert_array_equal(other.position, log.position[374:])
    np.testing.assert_array_equal(one.outer, jnp.stack([log.input[0], log.input[374]]))
    np.testing.assert_array_equal(other.outer, jnp.stack([log.input[373], log.input[-1]]))


def test_padding_is_cut_off_where_a_log_is(parts):
    """Batches of a padded log equal those of the log itself.

    Padding that counted as samples would pretend that the axis rests.
    """
    log = parts[0]
    few = SMALL._replace(samples=400)
    for size in (800, 1024, 3000):
        found, expected = (batches([x], few) for x in (filled(log, size), log))
        assert [int(x.counted.sum()) for (x,) in found] == [374, 375]
        for (part,), (own,) in zip(found, expected, strict=True):
            assert bool(jnp.all(part.counted))
            np.testing.assert_array_equal(part.position, own.position)
            np.testing.assert_array_equal(part.outer, own.outer)
    padded = filled(log, 1000).part(700, 900)
    assert (padded.input.size, int(padded.counted.sum())) == (200, 49)


def test_batches_prove_what_the_whole_does(parts):
    told = []
    report = lambda message, share: told.append((message, share))  # noqa: E731
    found = identify(motor.system(), parts, sizes=SMALL, report=report)
    assert (found.batches, found.samples_per_weight) == (2, pytest.approx(1498 / 300))
    assert told[0] == ("batch 1 of 2: smallest consistent disturbance bound", 0.0)
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] < 1.0
    estimate = found.estimate
    for lower, upper in ((estimate.lower, estimate.upper), (found.lower, found.upper)):
        assert np.all((lower <= TRUTH) & (upper >= TRUTH))
    assert np.all((found.lower >= estimate.lower) & (found.upper <= estimate.upper))
    # no interval is wider than that of either half alone
    one_batch = SMALL._replace(samples=10_000)
    for half in (parts[:2], parts[2:]):
        alone = identify(motor.system(), half, sizes=one_batch)
        assert np.all((found.lower >= alone.lower - 1e-9) & (found.upper <= alone.upper + 1e-9))
    whole = identify(motor.system(), parts, sizes=one_batch)
    assert whole.batches == 1
    widths = (found.upper - found.lower) / (whole.upper - whole.lower)
    assert np.all(widths < 1.01), widths
    # if the batches are not processed together, some intervals are wider
    apart = identify(motor.system(), parts, sizes=SMALL._replace(together=2000))
    assert np.all((apart.lower <= TRUTH) & (apart.upper >= TRUTH))
    widths = (apart.upper - apart.lower) / (whole.upper - whole.lower)
    assert np.all(widths < 1.5), widths
    assert np.any(widths > 1.1), widths


def test_an_interruption_leaves_the_intervals_of_the_batches_before(parts):
    def interrupted(message, share):
        if message.startswith("batch 2 of 2"):
            raise KeyboardInterrupt

    with pytest.raises(InterruptedIdentification, match="after 1 of 2 batches") as stopped:
        identify(motor.system(), parts, sizes=SMALL, report=interrupted)
    found, alone = stopped.value.found, identify(motor.system(), parts[:2], sizes=SMALL)
    assert (found.batches, stopped.value.batches) == (1, 2)
    np.testing.assert_array_equal(found.lower, alone.lower)
    np.testing.assert_array_equal(found.upper, alone.upper)

    def at_once(message, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        identify(motor.system(), parts, sizes=SMALL, report=at_once)
    assert not isinstance(stopped.value, InterruptedIdentification)


def test_one_bad_batch_contradicts_the_axis(parts):
    """An additional 0.6 V in one batch is more than δ ≤ 0.25 V explains.

    The factor is that of this batch.
    """
    first, second, third, last = parts
    pushed = Log(third.input.at[300:600].add(0.6), third.position, PERIOD, third.resolution)
    _, error = proved(motor.system(), [first, second, pushed, last])
    assert "unless the disturbance bound is at least" in str(error)
    _, alone = proved(motor.system(), [pushed, last])
    assert error.factor == pytest.approx(alone.factor, rel=2e-3)
    assert error.factor > 1.0


def test_batches_that_contradict_one_another(parts):
    """Logs of two axes with different parameters: each is consistent alone, both are not."""
    system, heavy = motor.system(), 1.45

    def scaled(log, factor):
        return Log(factor * log.input, log.position, PERIOD, log.resolution)

    other = [scaled(log, heavy) for log in parts[:2]]
    assert proved(system, other)[0] is not None
    _, error = proved(system, [*parts[:2], *other])
    # the factor of δ that both need together, although each alone needs no more than δ
    assert error.factor > 1.0
    assert "unless the disturbance bound is at least" in str(error)
    # batches too long to be processed together: the message may have no factor
    small = SMALL._replace(samples=800, together=1500)
    _, apart = proved(system, [parts[1], parts[0], *other], small)
    assert apart.factor is None or apart.factor <= error.factor * 1.001
    assert apart.factor is not None or "explains the first 3 batches" in str(apart)


def test_a_parameter_that_one_batch_identifies_is_identifiable(parts):
    """A batch at constant speed does not identify M, but another batch does."""
    n, speed = 1200, 0.5
    u = jnp.full(n, TRUTH[1] * speed + TRUTH[2] + TRUTH[3])
    y = jnp.round((0.1 + speed * PERIOD * jnp.arange(n + 1)) / 1e-6) * 1e-6
    slow = Log(u, y, PERIOD, 1e-6)
    assert "M" in identify(motor.system(), slow, sizes=SMALL).unidentifiable
    found = identify(motor.system(), [slow, *parts[:2]], sizes=SMALL)
    assert found.batches == 2
    assert not found.unidentifiable


def at_speed(speed):
    """Return 400 samples of the motor at a constant speed."""
    u = jnp.full(400, TRUTH[1] * speed + TRUTH[2] + TRUTH[3])
    y = jnp.round(speed * PERIOD * jnp.arange(401) / 1e-6) * 1e-6
    return Log(u, y, PERIOD, 1e-6)


def test_what_only_two_batches_identify_together_is_identifiable():
    """Two speeds together separate friction from damping; one of them alone does not."""
    sizes = SMALL._replace(samples=500)
    small = motor.system().with_disturbance_bound(ConstantBound(0.02))
    slow, fast = at_speed(0.2), at_speed(1.5)
    assert "B" in identify(small, slow, sizes=sizes).unidentifiable
    assert "B" in identify(small, fast, sizes=sizes).unidentifiable
    found = identify(small, [slow, fast], sizes=sizes)
    assert found.batches == 2
    assert "B" not in found.unidentifiable
    assert "M" in found.unidentifiable
    # the same for batches too long to be processed together, by the most informative ones
    sizes = sizes._replace(together=900)
    longer = [at_speed(v) for v in (0.2, 0.21, 0.2, 1.5, 0.2, 1.4)]
    chosen = most_informative(small, [[log] for log in longer], sizes)
    assert len(chosen) == 2
    assert sum(log is longer[3] for log in chosen) == 1
    found = identify(small, longer, sizes=sizes)
    assert found.batches == 6
    assert "B" not in found.unidentifiable


def test_short_logs_take_no_weights_from_a_long_one(parts):
    """60 logs of 10 samples do not widen the intervals from a log of 749 samples."""
    sizes = SMALL._replace(knots=150)
    long, short = parts[0], [cut(parts[1], 10 * k, 10) for k in range(60)]
    alone = identify(motor.system(), long, sizes=sizes)
    beside = identify(motor.system(), [long, *short], sizes=sizes)
    assert beside.batches == 1
    assert beside.samples_per_weight == pytest.approx(1349 / (83 + 60 * 2))
    assert beside.samples_per_weight == samples_per_weight(150, [long, *short])
    widths = (beside.estimate.upper - beside.estimate.lower) / (
        alone.estimate.upper - alone.estimate.lower
    )
    assert np.all(widths < 1.01), widths


def test_what_no_disturbance_explains_is_a_contradiction(parts):
    """An input of wrong sign and unit is inconsistent for every tested δ."""
    first = parts[0]
    wrong = Log(-1e4 * first.input, first.position, PERIOD, first.resolution)
    for logs in ([wrong], [*parts[:2], wrong]):
        _, error = proved(motor.system(), logs)
        assert error.factor == MOST
        assert "at least 1000·δ." in str(error)


def test_no_logs_and_single_precision_are_refused(parts):
    with pytest.raises(ValueError, match="`logs` must hold one log at least"):
        identify(motor.system(), [])
    single = Log(*(x.astype(jnp.float32) for x in (parts[0].input, parts[0].position)), PERIOD, 0.0)
    with pytest.raises(ValueError, match="`logs` must be float64"):
        identify(motor.system(), single)


def random_slide_log(seed, share=0.0, substeps=1):
    """Return 600 samples of a closed loop with random jerks and Δ = ±share·δ of random sign."""
    jerk = np.random.default_rng(seed).choice([-200.0, 200.0], 30)
    motion = uniform(jnp.array([0.1, 0.0, 0.0]), jnp.asarray(jerk), 0.02)
    controller = jd.PDFeedforward(slide(), slide().centre, kp=5000.0, kd=300.0)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 60).repeat(10)
    plant = jd.Plant(slide(), (7.0, 20.0, 15.0), Sequence(share * jnp.asarray(signs)))
    return run(plant, controller, jd.Servo(0.001, 1e-6), motion, substeps=substeps).log


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_the_disturbance_that_is_told_was_there(share):
    """The reported factor of δ is never larger than that of the simulated disturbance."""
    for seed in range(4):
        log = random_slide_log(seed, share, substeps=20)
        found = identify(slide(), log)
        assert found.disturbance_factor <= max(share * (1 + 1e-9), LEAST)


def scaled(log, factor):
    return Log(factor * log.input, log.position, log.period, log.resolution)


@pytest.mark.parametrize("order", [(0, 1), (1, 0), (1, 1, 0)])
def test_batches_that_contradict_each_other_are_refused_in_any_order(order):
    """The batches are too long to be processed together, but each is compared with all others."""
    sizes = BatchSizes(samples=200, logs=3, together=400)
    logs = random_slide_log(0), scaled(random_slide_log(1), 1.16)
    for log in logs:
        identify(slide(), log, sizes=sizes)
    with pytest.raises(InconsistentLogError):
        identify(slide(), [logs[k] for k in order], sizes=sizes)


def test_the_disturbance_that_batches_need_together_is_told():
    """Each batch alone needs less than 0.3·δ, but both together need more, which is reported."""
    logs = scaled(random_slide_log(0), 1.06), scaled(random_slide_log(1), 0.96)
    sizes = BatchSizes(samples=600)
    alone = [identify(slide(), log, sizes=sizes).disturbance_factor for log in logs]
    together = identify(slide(), logs, sizes=sizes)
    assert together.batches == 2
    assert max(alone) < 0.3 < together.disturbance_factor <= 1
    whole = identify(slide(), logs)
    assert whole.batches == 1
    assert together.disturbance_factor >= 0.8 * whole.disturbance_factor


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda log: [], "one log at least, but is empty"),
        (lambda log: cut(log, 0, 0), "two samples or more, but log 0 has 0"),
        (lambda log: [log, cut(log, 0, 1)], "two samples or more, but log 1 has 1"),
    ],
)
def test_what_is_no_log_is_refused(parts, wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        identify(motor.system(), wrong(parts[0]))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_log_must_be_finite(parts, bad):
    log = parts[0]
    with pytest.raises(ValueError, match=r"`position` of a log must be finite, .* at sample 17"):
        Log(log.input, log.position.at[17].set(bad), log.period, log.resolution)
    with pytest.raises(ValueError, match=r"`input` of a log must be finite, .* at sample 3"):
        Log(log.input.at[3].set(bad), log.position, log.period, log.resolution)


def test_a_program_that_the_simplex_method_does_not_solve_ends():
    """The log is undisturbed, with zero friction: its linear programs are degenerate.

    The simplex method of HiGHS made no progress in 270,000 steps (15 s).
    """
    system = jd.System(
        (
            jd.Term("m", "kg", (8.0, 16.0)),
            jd.Term("b", "N s/m", (0.0, 120.0), jd.Viscous()),
            jd.Term("Fc", "N", (0.0, 50.0), jd.Coulomb(beta=1000.0)),
            jd.Term("g0", "N", (90.0, 140.0), jd.Constant()),
        ),
        jd.ConstantBound(5.0),
        "N",
    )
    theta = (8.0, 120.0, 0.0, 90.0)
    jerk = np.repeat(np.random.default_rng(0).choice([-40.0, 0.0, 40.0], 30), 2)
    motion = uniform(jnp.array([0.3, 0.0, 0.0]), jnp.asarray(jerk), 0.02)
    controller = jd.PDFeedforward(system, system.centre, kp=50000.0, kd=1500.0)
    log = run(
        jd.Plant(system, theta, NoDisturbance()), controller, jd.Servo(0.001, 1e-6), motion
    ).log
    found = identify(system, log)
    assert np.all((found.lower <= np.array(theta)) & (np.array(theta) <= found.upper))
    assert found.upper[2] < 6
