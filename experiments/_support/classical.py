"""Criteria of classical experimental design: functions of the information alone."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid._types import Scalar
from jaxid.design.criteria import Criterion
from jaxid.loop.record import rows_of
from jaxid.model.system import System, smoothed
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory


class InformationCriterion(Criterion):
    """A classical criterion of a motion, for a design.

    Attributes:
        system: with its δ and regressors.
        criterion: D, A or E, as of `Information`.
    """

    system: System
    criterion: str = eqx.field(static=True)

    def near(self, task: Task, motion: JerkTrajectory) -> "Information":
        return self._with(task, 64)

    def coarse(self, task: Task, motion: JerkTrajectory) -> "Information":
        return self._with(task, 5)

    def _with(self, task: Task, nodes: int) -> "Information":
        speed = jnp.max(jnp.abs(task.limits.velocity))
        return Information(self.system, self.criterion, speed, nodes)


class Information(eqx.Module):
    """Log of a size of the covariance that Δ would leave were it white noise of deviation δ.

    Parameters are relative to the prior box, so that their units do not matter. Free: the whole
    motion, which is sought for this criterion; of several, the best by what it guarantees counts.

    Attributes:
        system: with its δ and regressors.
        criterion: D, the mean log axis of the ellipsoid; A, the sum of the variances; E, the
            longest axis.
        speed: over which jumps are spread at smoothing 1, m/s or rad/s.
        nodes: of the midpoint rule, per interval of the motion.
    """

    system: System
    criterion: str = eqx.field(static=True)
    speed: Scalar = eqx.field(converter=jnp.asarray)
    nodes: int = eqx.field(static=True, default=5)

    def __check_init__(self) -> None:
        require(
            self.criterion in ("D", "A", "E"),
            f"Argument `criterion` must be D, A or E, but is {self.criterion!r}.",
        )

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Jumps are also spread over the speed that changes from node to node."""
        states, weights = trajectory.midpoints(self.nodes)
        step = jnp.abs(states.acceleration) * weights / 2
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, weights)
        return self._size(self._information(rows.regressors / rows.delta[:, None], rows.measure))

    def _information(
        self, phi: Float[Array, "n m"], measure: Float[Array, " n"]
    ) -> Float[Array, "m m"]:
        relative = phi * self.system.half_widths[None]
        return (relative * measure[:, None]).T @ relative

    def _size(self, P: Float[Array, "m m"]) -> Scalar:
        match self.criterion:
            case "D":
                return -jnp.linalg.slogdet(P)[1] / (2 * P.shape[0])
            case "A":
                return jnp.log(jnp.trace(jnp.linalg.inv(P))) / 2
            case _:
                return -jnp.log(jnp.linalg.eigvalsh(P)[0]) / 2
